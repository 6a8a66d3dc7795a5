//! Where a run begins: anew, or where an interrupted one left off.

use std::time::Duration;

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::train::{
    Session,
    checkpoint::{self, LoopState, Refusal},
};
use crate::{error::ReconstructError, process};
use omnilife_engine::{
    model::Model,
    step::{StepSums, settings::TrainSettings},
};

/// The beginning, or where the session's checkpoint left off.
pub(super) fn resume(
    model: Model,
    settings: &TrainSettings,
    session: &Session<'_>,
    remarks: &mut Vec<String>,
) -> Result<(LoopState, Model), ReconstructError> {
    let mut say = |line: String| {
        session.progress.note(&line);
        remarks.push(line);
    };
    if let Some(files) = &session.files
        && files.checkpoint.exists()
    {
        let path = &files.checkpoint;
        match checkpoint::read(path, &files.inputs_sha256, settings, &model) {
            Ok(mut checkpoint) => {
                say(format!(
                    "continued from the checkpoint at iteration {} of {}",
                    checkpoint.state.iteration, settings.iterations
                ));
                checkpoint.state.resumed += 1;
                return Ok((checkpoint.state, checkpoint.model));
            }
            Err(Refusal::OtherRun(reason)) => say(format!(
                "{}: not continued, {reason}; training begins anew",
                path.display()
            )),
            Err(Refusal::Damaged(error)) => return Err(error.into()),
        }
    }
    let state = LoopState {
        iteration: 0,
        random: Pcg64Mcg::seed_from_u64(settings.seed),
        queue: Vec::new(),
        last_reset: 0,
        training: Duration::ZERO,
        evaluation: Duration::ZERO,
        training_cpu: process::cpu_time().map(|_| Duration::ZERO),
        since_trace: StepSums::default(),
        refused: Vec::new(),
        trace: Vec::new(),
        resumed: 0,
    };
    Ok((state, model))
}
