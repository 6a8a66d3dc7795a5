//! What a training step takes.

use std::time::Instant;

use omnilife_engine::schedule::Position;

use crate::{error::ReconstructError, learner::Learner};

/// The least wall-clock time of some training steps for each of some learners, seconds, with everything
/// taking part that does at the end of a schedule of `iterations`. The learners take turns, and what
/// else the machine does only ever adds to a step's time: the least ones compare where medians do not.
/// The learners are changed by the steps and are of no further use.
///
/// # Errors
/// When a loss is not finite.
pub fn step_seconds<const N: usize>(
    learners: [&mut dyn Learner; N],
    (views, iterations): (usize, u64),
    rounds: usize,
) -> Result<[f64; N], ReconstructError> {
    let end = Position {
        iteration: 1,
        share: 1.0,
        scheduled: iterations,
    };
    let mut least_seconds = [f64::INFINITY; N];
    let mut learners = learners;
    // The first round fills buffers.
    for round in 0..=rounds {
        for (learner, least) in learners.iter_mut().zip(&mut least_seconds) {
            let begun = Instant::now();
            learner.step(round * views / (rounds + 1), &end)?;
            if round > 0 {
                *least = least.min(begun.elapsed().as_secs_f64());
            }
        }
    }
    Ok(least_seconds)
}
