//! What is written is read back, and what is damaged or of another run is refused.

use rand::SeedableRng;

use crate::train::checkpoint::*;
use omnilife_engine::{
    gaussians::static_gaussians::{self, InitialGaussians, POSITIONS},
    model::pose_corrections::PoseCorrections,
};

fn model() -> Model {
    Model::new(static_gaussians::table(
        &InitialGaussians {
            positions: vec![[1.0, 2.0, 3.0]; 4],
            scales: vec![0.5; 4],
            colours: vec![[0.5; 3]; 4],
            opacities: vec![0.5; 4],
        },
        1,
    ))
}

fn state() -> LoopState {
    LoopState {
        iteration: 7,
        random: Pcg64Mcg::seed_from_u64(u64::MAX),
        queue: vec![2, 0, 1],
        last_reset: 3,
        training: Duration::from_nanos(1_234_567_891),
        evaluation: Duration::from_millis(5),
        training_cpu: Some(Duration::from_millis(7)),
        since_trace: StepSums {
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
    let settings = crate::baseline::published_settings(30_000);
    let mut written = model();
    let mut moving = model().table;
    moving.add("peak_times", 1, vec![0.5; 4], 0.0);
    written.moving = Some(MovingGaussians::new(moving));
    written.deformation = Some(DeformationWeights::new(vec![0.5; 9]));
    written.poses = Some(PoseCorrections::new(vec![0.5, 0.0]));
    let template = written.clone();
    written.table.arrays[2].second_moments[5] = f32::MIN_POSITIVE / 3.0;
    written.statistics.views[1] = u32::MAX;
    if let Some(moving) = &mut written.moving {
        moving.table.retain(&[true, false, true, true]);
        moving.forget_statistics();
        moving.time_gradients[2] = 0.25;
    }
    if let Some(weights) = &mut written.deformation {
        weights.array.second_moments[8] = 0.125;
        weights.steps = 6;
    }
    if let Some(poses) = &mut written.poses {
        poses.table.arrays[1].values[4] = -1e-7;
        poses.steps[1] = 3;
    }
    write(&path, "inputs", &settings, &state(), &written)?;
    let read = read(&path, "inputs", &settings, &template);
    let Ok(read) = read else {
        panic!("{:?}", read.map(drop));
    };
    assert_eq!((read.state, read.model), (state(), written));
    Ok(())
}

#[test]
fn a_value_that_is_not_finite_is_neither_written_nor_read() -> Result<(), Box<dyn std::error::Error>>
{
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("checkpoint.bin");
    let settings = crate::baseline::published_settings(30_000);
    let mut poisoned = model();
    poisoned.table.arrays[POSITIONS].first_moments[10] = f32::NAN;
    let refused = write(&path, "inputs", &settings, &state(), &poisoned);
    let message = refused.expect_err("poisoned").to_string();
    assert!(
        message.contains("positions of Gaussian 3 is not finite"),
        "{message}"
    );
    assert!(!path.exists());

    // Somebody else wrote it, with a hash that is right.
    write(&path, "inputs", &settings, &state(), &model())?;
    let bytes = fs::read(&path)?;
    let (header, healthy) = split(&bytes)?;
    let sick = body(&poisoned);
    let header = header.replace(&store::sha256_bytes(healthy), &store::sha256_bytes(&sick));
    fs::write(
        &path,
        [format!("{MAGIC}{VERSION}\n{header}\n").as_bytes(), &sick].concat(),
    )?;
    match read(&path, "inputs", &settings, &model()) {
        Err(Refusal::Damaged(error)) => {
            let message = error.to_string();
            assert!(message.contains("positions of Gaussian 3"), "{message}");
        }
        other => panic!("{:?}", other.map(drop)),
    }
    Ok(())
}
