//! Checkpoints: written ones are read back, and damaged ones or those of another run are refused.

use omnilife_engine::{EngineError, camera::View, model::TrainedArray, schedule::Position};
use omnilife_schemas::{RgbImage, records::Backend};
use rand::SeedableRng;

use super::*;
use crate::{error::ReconstructError, learner::ModelSize};

/// A learner that stores its inputs.
#[derive(Debug, PartialEq)]
struct StoredInputs(Vec<u8>);

impl Learner for StoredInputs {
    fn backend(&self) -> Backend {
        Backend::Cpu { threads: 1 }
    }

    fn size(&self) -> ModelSize {
        ModelSize::default()
    }

    fn arrays(&self) -> Vec<TrainedArray> {
        Vec::new()
    }

    fn step(&mut self, _: usize, _: &Position) -> Result<(), EngineError> {
        Ok(())
    }

    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError> {
        Ok(StepStatistics::default())
    }

    fn image(&mut self, _: &View) -> Result<RgbImage, EngineError> {
        Ok(RgbImage::from_rgb8(1, 1, &[0; 3]))
    }

    fn save(&mut self) -> Result<SavedLearner, EngineError> {
        Ok(SavedLearner {
            header: "remembered".to_owned(),
            body: self.0.clone(),
        })
    }

    fn restore(&mut self, saved: &SavedLearner) -> Result<(), LoadError> {
        if saved.header != "remembered" {
            return Err(LoadError::Other);
        }
        if saved.body.contains(&255) {
            return Err(LoadError::Damaged("holds a 255".to_owned()));
        }
        self.0.clone_from(&saved.body);
        Ok(())
    }

    fn export(&mut self, _: &Path) -> Result<Vec<String>, ReconstructError> {
        Ok(Vec::new())
    }
}

const SETTINGS: LoopSettings = LoopSettings {
    iterations: 10,
    budget_seconds: Some(0.1 + 0.2),
    seed: 3,
    trace_every: Some(2),
};

const NORMALIZATION: Similarity = Similarity {
    offset: [1.0, -2.0, 0.1 + 0.2],
    scale: 0.25,
};

fn state() -> LoopState {
    LoopState {
        iteration: 7,
        view_order: Pcg64Mcg::seed_from_u64(u64::MAX),
        queue: vec![2, 0, 1],
        training: Duration::from_nanos(1_234_567_891),
        evaluation: Duration::from_millis(5),
        training_cpu: Some(Duration::from_millis(7)),
        since_trace: StepStatistics {
            steps: 7,
            loss: 0.1 + 0.2,
            squared_error: 1e-300,
            refused: vec![0, 3],
        },
        refused: vec![1],
        trace: Vec::new(),
        resumed: 2,
    }
}

#[test]
fn what_is_written_is_read_back_to_the_bit() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("checkpoint.bin");
    let mut learner = StoredInputs(vec![1, 2, 3, b'\n', 0]);
    let saved = learner.save()?;
    write(&path, "inputs", &SETTINGS, &NORMALIZATION, &state(), &saved)?;
    let mut read_back = StoredInputs(Vec::new());
    let read = read(&path, "inputs", &SETTINGS, &mut read_back);
    let Ok(read) = read else {
        panic!("{:?}", read.map(drop));
    };
    assert_eq!((read, read_back), (state(), learner));
    Ok(())
}

#[test]
fn what_is_of_another_run_or_damaged_is_told_apart() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("checkpoint.bin");
    let save =
        |saved: &SavedLearner| write(&path, "inputs", &SETTINGS, &NORMALIZATION, &state(), saved);
    let refusal = |inputs: &str, settings: &LoopSettings| match read(
        &path,
        inputs,
        settings,
        &mut StoredInputs(Vec::new()),
    ) {
        Ok(_) => panic!("it is refused"),
        Err(Refusal::OtherRun(reason)) => (true, reason),
        Err(Refusal::Damaged(error)) => (false, error.to_string()),
    };
    save(&StoredInputs(vec![1]).save()?)?;
    let others = LoopSettings {
        seed: 4,
        ..SETTINGS
    };
    assert!(refusal("inputs", &others).0 && refusal("others", &SETTINGS).0);
    save(&SavedLearner {
        header: "another".to_owned(),
        body: Vec::new(),
    })?;
    assert!(refusal("inputs", &SETTINGS).0);
    save(&StoredInputs(vec![255]).save()?)?;
    let (is_other, reason) = refusal("inputs", &SETTINGS);
    assert!(!is_other && reason.contains("holds a 255"), "{reason}");
    Ok(())
}
