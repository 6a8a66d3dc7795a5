//! Plane samples of `nag` in a second, by the size of its fields: a step of 6,144 rays through two objects and
//! the background, with all fields. On the CPU and, where there is an adapter, on a GPU.
//!
//! `cargo bench --bench atlas`; criterion's element is a plane sample.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3};
use omnilife_engine::{
    device::adapters::adapters, schedule::Position, trajectories::rigid_spline::RigidPose,
};
use omnilife_reconstruct::{
    learner::Learner,
    methods::{
        self,
        neural_atlas::{
            begin,
            clip::{Clip, ClipFrame, UnitClock},
            learner::AtlasLearner,
        },
    },
    options::Options,
    request::{MethodRequest, PlanChoice},
};
use omnilife_schemas::camera::PinholeCamera;

const WIDTH: usize = 160;
const HEIGHT: usize = 96;
const FRAMES: usize = 16;
const STEPS: u64 = 300;

/// Makes stripes, and two objects that cover a third of the frame each.
fn clip() -> Clip {
    let column = |pixel: usize| pixel % WIDTH;
    let mask = |object: usize| {
        let covers = |pixel| 3 * column(pixel) / WIDTH == object;
        Some(
            (0..WIDTH * HEIGHT)
                .map(|pixel| if covers(pixel) { 255 } else { 0 })
                .collect(),
        )
    };
    let frame = |number: usize| ClipFrame {
        number: number as u32,
        time: number as f64 / (FRAMES - 1) as f64,
        pose: RigidPose {
            centre: DVec3::ZERO,
            rotation: DMat3::IDENTITY,
        },
        pixels: (0..WIDTH * HEIGHT)
            .flat_map(|pixel| [(7 * column(pixel) % 256) as u8; 3])
            .collect(),
        masks: vec![mask(0), mask(1)],
        ignored: None,
    };
    Clip {
        camera: PinholeCamera::new([WIDTH as u32, HEIGHT as u32], [160.0, 160.0], [80.0, 48.0])
            .into(),
        frames: (0..FRAMES).map(frame).collect(),
        objects: ["left", "middle"].map(str::to_owned).to_vec(),
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    }
}

fn learner(size: &str) -> AtlasLearner {
    let method = methods::find("nag").expect("the method is registered");
    let lines = [
        format!("base-fields={size}"),
        format!("motion-fields={size}"),
        "rays=6144".to_owned(),
    ];
    let mut request = MethodRequest::new(STEPS, 1);
    request.options =
        Options::parse("nag", method.options, &lines).expect("the options are the method's");
    request.plan = PlanChoice::Full;
    begin(clip(), &[], &request)
        .expect("the clip can be trained on")
        .learner
}

fn throughput(criterion: &mut Criterion) {
    measure(criterion, "nag", false);
    if !adapters().is_empty() {
        measure(criterion, "nag-gpu", true);
    }
}

fn measure(criterion: &mut Criterion, name: &str, on_gpu: bool) {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10);
    for size in ["small", "medium", "large"] {
        let mut learner = learner(size);
        if on_gpu {
            learner.move_to_gpu().expect("the adapter opens");
        }
        let at = Position::new(STEPS, None, STEPS / 2, 0.0);
        let before = learner.samples();
        learner
            .step(0, &at)
            .expect("a step of a sound clip succeeds");
        group.throughput(Throughput::Elements(learner.samples() - before));
        group.bench_function(size, |bencher| {
            bencher.iter(|| learner.step(0, &at));
        });
    }
    group.finish();
}

criterion_group!(benches, throughput);
criterion_main!(benches);
