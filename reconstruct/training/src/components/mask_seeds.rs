//! Component: dynamic Gaussians start on the masked pixels.

use crate::{
    components::{Component, Decision, Draft, Turn, draft::Seeding},
    evidence::SceneEvidence,
    seeds::masks::{SeedSettings, mask_seeds},
};

/// Its name.
pub const ID: &str = "mask-seeds";

/// Mask seeds.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Mask seeds",
    description: "Short-lived Gaussians begin on the masked pixels of the input views, at the views' \
                  times: structure from motion has no points on what moves. Used where masks show \
                  something.",
    turn: Turn::BeforePoints,
    needs_pilot: |_, _| false,
    decide,
    apply,
};

/// Default first lifespan of a seed: four tenths of PVG's cycle of 10 frames. That is well below the staticness
/// of static Gaussians, but still some frames.
pub const LIFESPAN_FRAMES: f32 = 4.0;
/// Maximum share of seeds among all Gaussians: they reduce the room of the static region.
const LARGEST_SHARE: f64 = 0.125;
/// Lifespans in which a seed is visible, with at least a quarter of its opacity: `2 sqrt(2 ln 4)`.
const SEEN_LIFESPANS: f32 = 3.33;

fn decide(evidence: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    let masks = &evidence.masks;
    let without_lives = draft.seeding.is_none();
    let missing = without_lives.then_some("Gaussians that appear and vanish");
    let without_masks = !masks.show_something();
    let missing = missing.or(without_masks.then_some("masks that show something"));
    Decision::new(true, masks.to_string()).unless(missing)
}

fn apply(draft: &mut Draft<'_>) {
    let Some(seeding) = draft.seeding else {
        return;
    };
    let coverage = draft.evidence.masks.coverage.unwrap_or(0.0);
    let share = share(coverage, &seeding);
    let room = draft.settings.densify.maximum_gaussians as f64 * share;
    let settings = SeedSettings {
        clock: seeding.clock,
        lifespan_frames: seeding.lifespan_frames,
        velocity: seeding.velocity,
        exposure: draft.settings.exposure.as_ref(),
        maximum: room.ceil() as usize,
        explained: &draft.explained,
    };
    draft.seeds = mask_seeds(draft.scene, &settings);
}

/// Returns the share of all Gaussians with which the masked region is as dense as the others at any time. It is
/// the region's share of the sphere, times the number of sets that follow each other in the clip.
fn share(coverage: f64, seeding: &Seeding) -> f64 {
    let seen_frames = SEEN_LIFESPANS * seeding.lifespan_frames;
    let sets = (seeding.clock.duration_frames / seen_frames).max(1.0);
    (coverage * f64::from(sets)).min(LARGEST_SHARE)
}

#[cfg(test)]
mod tests {
    use omnilife_engine::clock::Clock;

    use super::*;
    use crate::seeds::masks::SeedVelocity;

    #[test]
    fn seeds_are_as_dense_as_the_rest() {
        let share = |coverage, duration_frames| {
            let seeding = Seeding {
                clock: Clock::new(0.0, 0.1, duration_frames),
                velocity: SeedVelocity::None,
                lifespan_frames: LIFESPAN_FRAMES,
            };
            share(coverage, &seeding)
        };
        // Five sets of one in a hundred; one set with a lifespan above the clip; a limit.
        for (found, expected) in [
            (share(0.01, 66.6), 0.05),
            (share(0.01, 3.0), 0.01),
            (share(0.6, 66.6), 0.125),
            (share(0.0, 66.6), 0.0),
        ] {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
    }
}
