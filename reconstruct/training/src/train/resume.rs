//! Start of a run: from the beginning, or from a checkpoint.

use super::{
    LoopSettings, Session,
    checkpoint::{self, LoopState, Refusal},
};
use crate::{
    error::ReconstructError,
    learner::Learner,
    random::{Purpose, stream},
};

/// Returns the first state, or that of the session's checkpoint, and brings `learner` to it.
pub(super) fn resume(
    learner: &mut dyn Learner,
    settings: &LoopSettings,
    session: &Session<'_>,
    warnings: &mut Vec<String>,
) -> Result<LoopState, ReconstructError> {
    let mut say = |line: String| {
        session.progress.note(&line);
        warnings.push(line);
    };
    if let Some(files) = &session.files
        && files.checkpoint.exists()
    {
        let path = &files.checkpoint;
        match checkpoint::read(path, &files.inputs_sha256, settings, learner) {
            Ok(mut state) => {
                say(format!(
                    "continued from the checkpoint at iteration {} of {}",
                    state.iteration, settings.iterations
                ));
                state.resumed += 1;
                return Ok(state);
            }
            // The line goes into the record of the run, which does not name the run's folder.
            Err(Refusal::OtherRun(reason)) => say(format!(
                "{}: not continued, {reason}; training begins anew",
                path.file_name().unwrap_or_default().display()
            )),
            Err(Refusal::Damaged(error)) => return Err(error.into()),
        }
    }
    let mut state = LoopState::new(stream(settings.seed, Purpose::ViewOrder));
    state.training = session.planning.wall();
    let planning_cpu = session.planning.cpu().unwrap_or_default();
    state.training_cpu = state.training_cpu.map(|time| time + planning_cpu);
    Ok(state)
}
