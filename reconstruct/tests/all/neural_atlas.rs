//! Neural Atlas Graphs on a clip with known truth: two textured planes, one passing behind the other, rendered
//! ray by ray in f64.

use std::time::Instant;

use glam::{DMat3, DVec2, DVec3, Mat3, Vec3};
use omnilife_engine::{
    camera::{Camera, View},
    model::saved::LoadError,
    schedule::Position,
    surfaces::plane::{Ray, hit},
    trajectories::rigid_spline::RigidPose,
};
use omnilife_reconstruct::{
    learner::Learner,
    methods::{
        self,
        neural_atlas::{
            AtlasStart, begin,
            clip::{Clip, ClipFrame, UnitClock, camera_direction, pixel_centre},
            front::FRONT,
            graph::Visibility,
            learner::AtlasLearner,
            saved,
        },
    },
    options::Options,
    request::{BackendChoice, MethodRequest},
};
use omnilife_schemas::camera::PinholeCamera;

use crate::support::post;

const WIDTH: usize = 160;
const HEIGHT: usize = 96;
const FRAMES: usize = 16;
const NAMES: [&str; 2] = ["far", "near"];

fn camera() -> Camera {
    PinholeCamera::new([WIDTH as u32, HEIGHT as u32], [160.0, 160.0], [80.0, 48.0]).into()
}

/// A textured plane of the truth.
struct Truth {
    size: DVec2,
    frequency: f64,
    phase: f64,
    is_object: bool,
}

impl Truth {
    fn colour(&self, uv: DVec2) -> DVec3 {
        let wave = |a: f64, b: f64, c: f64| {
            0.5 + 0.2 * (self.frequency * (a * uv.x + b * uv.y) + self.phase + c).sin()
                + 0.2 * (self.frequency * (b * uv.x - a * uv.y) + 2.0 * c).cos()
        };
        DVec3::new(
            wave(1.0, 0.4, 0.0),
            wave(0.3, 1.1, 1.0),
            wave(-0.8, 0.7, 2.0),
        )
    }

    /// Returns the opacity of an ellipse with a soft edge; 1 for the background.
    fn opacity(&self, uv: DVec2) -> f64 {
        if !self.is_object {
            return 1.0;
        }
        let radius = ((uv - 0.5) / 0.4).length();
        1.0 / (1.0 + ((radius - 1.0) * 40.0).exp())
    }
}

fn truths() -> [Truth; 3] {
    let truth = |size: [f64; 2], frequency, phase, is_object| Truth {
        size: DVec2::from_array(size),
        frequency,
        phase,
        is_object,
    };
    [
        truth([0.9, 0.8], 9.0, 0.4, true),
        truth([0.7, 0.6], 8.0, 1.9, true),
        truth([8.0, 6.0], 22.0, 0.0, false),
    ]
}

/// Returns the poses of the planes: the far object moves right and behind the near one, which moves left.
fn poses(time: f64) -> [RigidPose; 3] {
    let pose = |centre: [f64; 3]| RigidPose {
        centre: DVec3::from_array(centre),
        rotation: DMat3::IDENTITY,
    };
    [
        pose([-0.9 + 1.3 * time, 0.15 - 0.2 * time, 3.0]),
        pose([0.5 - 0.7 * time, -0.05, 2.0]),
        pose([0.0, 0.0, 4.0]),
    ]
}

/// Returns a pixel's colour, and its visible coverage by each object.
fn draw(time: f64, pixel: usize, without: Option<usize>) -> (DVec3, [f64; 2]) {
    let ray = Ray {
        origin: DVec3::ZERO,
        direction: camera_direction(&camera(), pixel_centre(pixel, WIDTH)),
    };
    let (mut colour, mut transmittance, mut covered) = (DVec3::ZERO, 1.0, [0.0; 2]);
    // The near object, the far one, the background.
    for node in [1, 0, 2] {
        if without == Some(node) {
            continue;
        }
        let truth = &truths()[node];
        if let Some(hit) = hit(&ray, &poses(time)[node], truth.size) {
            let weight = transmittance * truth.opacity(hit.uv);
            colour += weight * truth.colour(hit.uv);
            transmittance *= 1.0 - truth.opacity(hit.uv);
            if node < 2 {
                covered[node] = weight;
            }
        }
    }
    (colour, covered)
}

fn time(frame: usize) -> f64 {
    frame as f64 / (FRAMES - 1) as f64
}

fn byte(value: f64) -> u8 {
    (255.0 * value).round() as u8
}

pub(crate) fn clip() -> Clip {
    let frame = |number: usize| {
        let drawn: Vec<(DVec3, [f64; 2])> = (0..WIDTH * HEIGHT)
            .map(|pixel| draw(time(number), pixel, None))
            .collect();
        let colours = drawn
            .iter()
            .flat_map(|(colour, _)| colour.to_array().map(byte));
        let mask = |object: usize| {
            let mask: Vec<u8> = drawn
                .iter()
                .map(|(_, covered)| if covered[object] > 0.5 { 255 } else { 0 })
                .collect();
            mask.contains(&255).then_some(mask)
        };
        ClipFrame {
            number: number as u32,
            time: time(number),
            pose: RigidPose {
                centre: DVec3::ZERO,
                rotation: DMat3::IDENTITY,
            },
            pixels: colours.collect(),
            masks: vec![mask(0), mask(1)],
            ignored: None,
        }
    };
    Clip {
        camera: camera(),
        frames: (0..FRAMES).map(frame).collect(),
        objects: NAMES.map(str::to_owned).to_vec(),
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    }
}

pub(crate) fn view(frame: usize) -> View {
    View {
        camera: camera(),
        rotation: Mat3::IDENTITY,
        centre: Vec3::ZERO,
        time_seconds: time(frame),
    }
}

pub(crate) fn learn(learner: &mut AtlasLearner, steps: std::ops::Range<u64>, of: u64) {
    for step in steps {
        let at = Position::new(of, None, step + 1, 0.0);
        learner.step(0, &at).unwrap();
    }
}

/// Returns the PSNR over pixels that a rule selects.
fn psnr(image: &[f32], truth: impl Fn(usize) -> DVec3, is_scored: impl Fn(usize) -> bool) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (pixel, rgb) in image.chunks_exact(3).enumerate() {
        if is_scored(pixel) {
            let found = DVec3::new(rgb[0].into(), rgb[1].into(), rgb[2].into());
            sum += (found - truth(pixel)).length_squared() / 3.0;
            count += 1;
        }
    }
    -10.0 * (sum / f64::from(count.max(1))).max(1e-12).log10()
}

const STEPS: u64 = 300;
/// Rays of a step: a third of a frame's pixels.
pub(crate) const RAYS: &str = "rays=6144";

#[test]
fn two_planes_are_taken_apart() {
    take_two_planes_apart(false, 1, &[RAYS]).check();
}

/// Scores of an atlas of the two-plane clip.
pub(crate) struct TwoPlaneScores {
    /// PSNR over all frames, dB.
    pub(crate) psnr_db: f64,
    /// Intersection over union of the mattes of both planes over all frames.
    pub(crate) overlap: [f64; 2],
    /// Largest distances of the planes' trajectories from the true ones, pixels.
    pub(crate) apart_px: [f64; 2],
    /// PSNR behind the near plane, once it is removed, dB.
    pub(crate) removed_db: f64,
}

impl TwoPlaneScores {
    pub(crate) fn check(&self) {
        assert!(self.psnr_db >= 40.0, "{:.2} dB", self.psnr_db);
        for object in 0..2 {
            assert!(self.overlap[object] >= 0.98, "{:?}", self.overlap);
            assert!(self.apart_px[object] <= 0.5, "{:?} px", self.apart_px);
        }
        assert!(self.removed_db >= 35.0, "{:.2} dB", self.removed_db);
    }
}

/// Trains on the two-plane clip and returns the scores of images, mattes, removal and trajectories.
pub(crate) fn take_two_planes_apart(on_gpu: bool, seed: u64, options: &[&str]) -> TwoPlaneScores {
    let begun = Instant::now();
    let method = methods::find("nag").unwrap();
    let options: Vec<String> = options.iter().map(|&option| option.to_owned()).collect();
    let request = MethodRequest {
        options: Options::parse("nag", method.options, &options).unwrap(),
        ..MethodRequest::new(STEPS, seed)
    };
    let AtlasStart {
        mut learner, plan, ..
    } = begin(clip(), &[], &request).unwrap();
    for line in &plan {
        println!("{}: {} ({})", line.component, line.used, line.reason);
    }
    if on_gpu {
        learner.move_to_gpu().unwrap();
    }
    learn(&mut learner, 0..STEPS, STEPS);
    let seconds = begun.elapsed().as_secs_f64();
    let graph = learner.graph().unwrap();
    let mut squared = 0.0;
    let (mut both, mut any) = ([0_u32; 2], [0_u32; 2]);
    let mut removed = Vec::new();
    for frame in 0..FRAMES {
        let drawn: Vec<(DVec3, [f64; 2])> = (0..WIDTH * HEIGHT)
            .map(|pixel| draw(time(frame), pixel, None))
            .collect();
        let (image, missed) = graph.image(&view(frame), &Visibility::All);
        assert_eq!(missed, 0);
        squared += 10_f64.powf(-0.1 * psnr(&image.data, |pixel| drawn[pixel].0, |_| true));
        for (object, name) in NAMES.iter().enumerate() {
            let (matte, _) = graph.image(&view(frame), &Visibility::Matte((*name).to_owned()));
            for (pixel, drawn) in drawn.iter().enumerate() {
                let (found, truth) = (matte.data[3 * pixel] > 0.5, drawn.1[object] > 0.5);
                both[object] += u32::from(found && truth);
                any[object] += u32::from(found || truth);
            }
        }
        let (image, _) = graph.image(&view(frame), &Visibility::Without("near".to_owned()));
        let truth: Vec<DVec3> = (0..WIDTH * HEIGHT)
            .map(|pixel| draw(time(frame), pixel, Some(1)).0)
            .collect();
        removed.push(psnr(
            &image.data,
            |pixel| truth[pixel],
            |pixel| drawn[pixel].1[1] > 0.5,
        ));
    }
    let total = -10.0 * (squared / FRAMES as f64).log10();
    let overlap = [0, 1].map(|object| f64::from(both[object]) / f64::from(any[object]));
    let removed_mean = -10.0
        * (removed.iter().map(|db| 10_f64.powf(-0.1 * db)).sum::<f64>() / FRAMES as f64).log10();
    // Motion of the planes in the image, relative to their mean position: the point of an object at its plane's
    // middle is not determined.
    let mut apart = [0.0_f64; 2];
    for (object, name) in NAMES.iter().enumerate() {
        let node = &graph.nodes[graph.find(name).unwrap()];
        let on_image = |centre: DVec3| 160.0 * centre.truncate() / centre.z;
        let differences: Vec<DVec2> = (0..FRAMES)
            .map(|frame| {
                let given = RigidPose {
                    centre: DVec3::ZERO,
                    rotation: DMat3::IDENTITY,
                };
                let camera = graph.camera_pose(&given, time(frame));
                let found = node.pose(time(frame)).centre - camera.centre;
                on_image(camera.rotation.transpose() * found)
                    - on_image(poses(time(frame))[object].centre)
            })
            .collect();
        let mean = differences.iter().sum::<DVec2>() / FRAMES as f64;
        for difference in differences {
            apart[object] = apart[object].max((difference - mean).length());
        }
    }
    println!(
        "{seconds:.1} s, {total:.2} dB, overlap {overlap:.4?}, trajectories {apart:.2?} px, \
         removal {removed_mean:.2} dB"
    );
    TwoPlaneScores {
        psnr_db: total,
        overlap,
        apart_px: apart,
        removed_db: removed_mean,
    }
}

fn small_request() -> MethodRequest {
    MethodRequest::new(12, 3)
}

/// Returns parameters and moments after all steps.
pub(crate) fn body(learner: &mut AtlasLearner) -> Vec<u8> {
    learner.save().unwrap().body
}

#[test]
fn a_run_that_is_taken_up_again_is_the_same_bit_for_bit_on_any_number_of_threads() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let mut learner = begin(clip(), &[], &small_request()).unwrap().learner;
            learn(&mut learner, 0..12, 12);
            body(&mut learner)
        })
    };
    let whole = with(1);
    assert!(whole == with(2), "one thread and two");
    let mut first = begin(clip(), &[], &small_request()).unwrap().learner;
    learn(&mut first, 0..7, 12);
    let saved = first.save().unwrap();
    let mut second = begin(clip(), &[], &small_request()).unwrap().learner;
    second.restore(&saved).unwrap();
    learn(&mut second, 7..12, 12);
    assert!(whole == body(&mut second), "taken up again");
    let mut other = begin(clip(), &[], &MethodRequest::new(12, 4))
        .unwrap()
        .learner;
    assert_eq!(other.restore(&saved), Err(LoadError::Other));
}

#[test]
fn an_atlas_is_read_back_as_it_was_written() {
    let mut learner = begin(clip(), &[], &small_request()).unwrap().learner;
    learn(&mut learner, 0..12, 12);
    let folder = tempfile::tempdir().unwrap();
    learner.export(folder.path()).unwrap();
    let mut read = saved::read(folder.path()).unwrap();
    let (expected, _) = learner.graph().unwrap().image(&view(5), &Visibility::All);
    let (found, _) = read.image(&view(5), &Visibility::All);
    assert_eq!(expected.data, found.data);
    std::fs::write(folder.path().join("atlas.bin"), [0; 40]).unwrap();
    let message = saved::read(folder.path()).unwrap_err().to_string();
    assert!(
        message.contains("atlas.bin") && message.lines().count() == 1,
        "{message}"
    );
}

#[test]
fn masks_that_leave_nothing_are_refused_and_empty_ones_have_a_reason() {
    let mut covered = clip();
    for frame in &mut covered.frames {
        frame.masks = vec![Some(vec![255; WIDTH * HEIGHT]), None];
    }
    let message = begin(covered, &[], &small_request())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("must leave the background visible"),
        "{message}"
    );
    let mut empty = clip();
    for frame in &mut empty.frames {
        frame.masks[0] = None;
    }
    let begun = begin(empty, &[], &small_request()).unwrap();
    let line = begun
        .plan
        .iter()
        .find(|line| line.component == "object:far")
        .unwrap();
    assert!(
        !line.used && line.reason.contains("empty"),
        "{}",
        line.reason
    );
}

#[test]
fn a_post_without_a_mask_is_found_in_a_scene_on_request() {
    let scene = post::scene();
    let method = methods::find("nag").unwrap();
    for is_asked_for in [false, true] {
        let mut request = small_request();
        if is_asked_for {
            request.with.push(FRONT.to_owned());
        }
        let prepared = method.prepare(&scene, &request, BackendChoice::Cpu);
        let plan = prepared.unwrap().findings.plan;
        let decision = plan.iter().find(|line| line.component == FRONT).unwrap();
        assert_eq!(decision.used, is_asked_for, "{plan:?}");
    }
}
