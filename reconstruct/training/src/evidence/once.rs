//! One pilot fit for many short runs on a scene.
//!
//! A pilot fit takes [`super::PILOT_ITERATIONS`] steps, and its evidence is the same on equal scenes and seeds. Tests
//! that compare many runs of fewer steps would spend most of their time on it.

use std::{cell::RefCell, marker::PhantomData};

use super::PilotEvidence;
use crate::{error::ReconstructError, scene::TrainingScene};

/// Evidence of a pilot fit with all that it was made of.
#[derive(Debug)]
struct Known {
    scene: TrainingScene,
    seed: u64,
    pilot: PilotEvidence,
}

thread_local! {
    /// Known evidence, while a [`PilotOnce`] lives.
    static KNOWN: RefCell<Option<Vec<Known>>> = const { RefCell::new(None) };
}

/// While it lives, its thread makes one pilot fit for equal scenes and seeds.
#[derive(Debug)]
#[must_use = "it ends where it is dropped"]
pub struct PilotOnce {
    /// False within another one, which keeps what is known.
    is_first: bool,
    /// It belongs to its thread.
    of_thread: PhantomData<*const ()>,
}

impl PilotOnce {
    /// Begins on this thread.
    pub fn begin() -> Self {
        let is_first = KNOWN.with_borrow_mut(|known| {
            let is_first = known.is_none();
            known.get_or_insert_default();
            is_first
        });
        Self {
            is_first,
            of_thread: PhantomData,
        }
    }
}

impl Drop for PilotOnce {
    fn drop(&mut self) {
        if self.is_first {
            KNOWN.set(None);
        }
    }
}

/// Returns the known evidence on an equal scene and seed, or gathers it.
pub(super) fn gathered(
    scene: &TrainingScene,
    seed: u64,
    gather: impl FnOnce() -> Result<PilotEvidence, ReconstructError>,
) -> Result<PilotEvidence, ReconstructError> {
    let known = KNOWN.with_borrow(|known| {
        let mut known = known.iter().flatten();
        let equal = known.find(|known| known.seed == seed && known.scene == *scene)?;
        Some(equal.pilot.clone())
    });
    if let Some(pilot) = known {
        return Ok(pilot);
    }
    let pilot = gather()?;
    KNOWN.with_borrow_mut(|known| {
        if let Some(known) = known {
            known.push(Known {
                scene: scene.clone(),
                seed,
                pilot: pilot.clone(),
            });
        }
    });
    Ok(pilot)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use omnilife_schemas::{Similarity, camera::ErpCamera};

    use super::*;
    use crate::evidence::{
        changing_light::ChangingLight,
        coverage::Coverage,
        motion::{ChangingPoints, MotionEvidence},
        poses::PoseEvidence,
        view_dependence::ViewDependence,
    };

    fn scene(id: &str) -> TrainingScene {
        let normalization = Similarity::new([0.0; 3], 1.0);
        TrainingScene::new(id, ErpCamera::new(8, 4).into(), Vec::new(), normalization)
    }

    fn pilot() -> PilotEvidence {
        PilotEvidence {
            exposure: None,
            poses: PoseEvidence::default(),
            motion: MotionEvidence::default(),
            changing: ChangingPoints {
                evidence: MotionEvidence::default(),
                changing: 0,
                unknown: 0,
                changes: Vec::new(),
            },
            coverage: Coverage::default(),
            view_dependence: ViewDependence::default(),
            changing_light: ChangingLight::default(),
        }
    }

    #[test]
    fn a_fit_is_made_once_for_equal_scenes_and_seeds_and_only_while_that_is_asked_for() {
        let fits = Cell::new(0);
        let gather = |scene: &TrainingScene, seed: u64| {
            let found = gathered(scene, seed, || {
                fits.set(fits.get() + 1);
                Ok(pilot())
            });
            assert_eq!(found.ok(), Some(pilot()));
            fits.get()
        };
        let (one, other) = (scene("one"), scene("other"));
        assert_eq!([gather(&one, 1), gather(&one, 1)], [1, 2]);
        let once = PilotOnce::begin();
        assert_eq!([gather(&one, 1), gather(&one, 1)], [3, 3]);
        assert_eq!([gather(&one, 2), gather(&other, 1)], [4, 5]);
        drop(PilotOnce::begin());
        let mut changed = one.clone();
        assert_eq!(gather(&changed, 1), 5);
        changed.points.positions.push([0.0; 3]);
        assert_eq!(gather(&changed, 1), 6);
        drop(once);
        assert_eq!(gather(&one, 1), 7);
    }
}
