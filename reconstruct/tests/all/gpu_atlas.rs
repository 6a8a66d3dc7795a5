//! Neural Atlas Graphs on a GPU: the two-plane clip, and a run that is taken up again.

use device::device;
use omnilife_reconstruct::{
    learner::Learner,
    methods::{
        self,
        neural_atlas::{begin, graph::Visibility, learner::AtlasLearner},
    },
    options::Options,
    request::MethodRequest,
};
use omnilife_schemas::records::Backend;

use crate::{
    neural_atlas::{RAYS, TwoPlaneScores, body, clip, learn, take_two_planes_apart, view},
    support::device,
};

const STEPS: u64 = 40;
/// Options of small fields and few rays: a software adapter takes a second for a step.
const SMALL: [&str; 3] = ["rays=1024", "base-fields=small", "motion-fields=tiny"];
/// Options for a comparison of bits, which any number of rays shows.
const FEW_RAYS: [&str; 3] = ["rays=256", "base-fields=small", "motion-fields=tiny"];

/// Returns a learner of the two-plane clip with small fields before its first step.
fn learner(options: [&str; 3], steps: u64, on_gpu: bool) -> AtlasLearner {
    let method = methods::find("nag").unwrap();
    let options = options.map(str::to_owned);
    let request = MethodRequest {
        options: Options::parse("nag", method.options, &options).unwrap(),
        ..MethodRequest::new(steps, 1)
    };
    let mut learner = begin(clip(), &[], &request).unwrap().learner;
    if on_gpu {
        learner.move_to_gpu().unwrap();
    }
    learner
}

/// Returns the root mean squared difference of two images.
fn apart(one: &[f32], other: &[f32]) -> f64 {
    let pairs = one.iter().zip(other);
    let squares = pairs.map(|(a, b)| f64::from(a - b).powi(2));
    (squares.sum::<f64>() / one.len() as f64).sqrt()
}

#[test]
fn two_planes_are_learnt_as_on_the_cpu() {
    if device().is_none() {
        return;
    }
    let [mut cpu, mut gpu] = [false, true].map(|on_gpu| learner(SMALL, STEPS, on_gpu));
    assert!(matches!(gpu.backend(), Backend::Gpu { .. }));
    for learner in [&mut cpu, &mut gpu] {
        learn(learner, 0..STEPS, STEPS);
    }
    let [of_cpu, of_gpu] = [&mut cpu, &mut gpu].map(|learner| learner.take_statistics().unwrap());
    println!("losses {} and {}", of_cpu.loss, of_gpu.loss);
    assert_eq!(
        (of_gpu.steps, of_gpu.refused.iter().sum::<u64>()),
        (STEPS, 0)
    );
    assert!((of_cpu.loss - of_gpu.loss).abs() < 1e-2 * of_cpu.loss);
    for frame in [0, 7, 15] {
        let [of_cpu, of_gpu] =
            [&mut cpu, &mut gpu].map(|learner| learner.image(&view(frame)).unwrap().data);
        let apart_db = -20.0 * apart(&of_cpu, &of_gpu).max(1e-9).log10();
        println!("frame {frame}: {apart_db:.1} dB apart");
        assert!(apart_db > 35.0, "{apart_db}");
    }
    // The device's image is that of its parameters on the host.
    let of_device = gpu.image(&view(5)).unwrap();
    let (of_host, _) = gpu.graph().unwrap().image(&view(5), &Visibility::All);
    assert!(apart(&of_device.data, &of_host.data) < 1e-4);
    // The run goes on after its parameters were on the host.
    learn(&mut gpu, STEPS - 1..STEPS, STEPS);
}

/// A software adapter would take minutes for 300 steps.
#[test]
fn a_graphics_card_takes_two_planes_apart() {
    let Some(gpu) = device() else { return };
    if gpu.adapter().kind.is_software() {
        return omnilife_schemas::testing::skip("a software adapter takes minutes for 300 steps");
    }
    take_two_planes_apart(true, 1, &[RAYS]).check();
}

/// Prints the scores of three seeds on the CPU and on the device.
#[test]
#[ignore = "a software adapter takes about ten minutes for each seed"]
fn two_planes_on_a_device_score_within_the_seeds_of_the_cpu() {
    if device().is_none() {
        return;
    }
    let seeds = |on_gpu| [1, 2, 3].map(|seed| take_two_planes_apart(on_gpu, seed, &SMALL));
    let [of_cpu, of_gpu] = [false, true].map(seeds);
    let mean = |scores: &[TwoPlaneScores; 3], score: fn(&TwoPlaneScores) -> f64| {
        scores.iter().map(score).sum::<f64>() / 3.0
    };
    for score in [
        |one: &TwoPlaneScores| one.psnr_db,
        |one: &TwoPlaneScores| one.removed_db,
        |one: &TwoPlaneScores| one.overlap[0],
        |one: &TwoPlaneScores| one.overlap[1],
    ] {
        let values = of_cpu.each_ref().map(score);
        let least = values.into_iter().fold(f64::INFINITY, f64::min);
        let largest = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let found = mean(&of_gpu, score);
        println!("CPU {values:.4?}, mean of the device {found:.4}");
        // A mean of three lies within the range of three others up to its own spread.
        let room = largest - least;
        assert!((least - room..=largest + room).contains(&found));
    }
}

#[test]
fn an_atlas_on_a_device_is_taken_up_again_bit_for_bit() {
    if device().is_none() {
        return;
    }
    let mut whole = learner(FEW_RAYS, 12, true);
    learn(&mut whole, 0..12, 12);
    let mut first = learner(FEW_RAYS, 12, true);
    learn(&mut first, 0..7, 12);
    let saved = first.save().unwrap();
    let mut second = learner(FEW_RAYS, 12, true);
    second.restore(&saved).unwrap();
    learn(&mut second, 7..12, 12);
    assert!(body(&mut whole) == body(&mut second));
    // A checkpoint of one backend is continued on the other.
    let mut on_cpu = learner(FEW_RAYS, 12, false);
    on_cpu.restore(&saved).unwrap();
    learn(&mut on_cpu, 7..12, 12);
}
