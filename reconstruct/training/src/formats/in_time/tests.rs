//! Models of every closed form, written, read and rendered; malformed files.

use glam::Vec3;
use omnilife_engine::{
    camera::{Camera, View},
    clock::Clock,
    gaussians::{
        ActivatedGaussians,
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        parameterization::Viewpoint,
        static_gaussians::{InitialGaussians, StaticGaussians, table},
        temporal::{InitialTimes, LifespanRange, TemporalFeatures, TimeModel, VelocityModel},
        temporal_gaussians::TemporalGaussians,
        tracked::{self, TrackedGaussians, TrackedObject},
    },
    model::layers::{Layer, LayerRenderer},
    render::settings::RenderSettings,
    trajectories::rigid_path::RigidPath,
};
use omnilife_schemas::{
    Pose,
    camera::ErpCamera,
    trajectory::{BSpline, ObjectPath},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{header::Motion, *};

const NORMALIZATION: Similarity = Similarity::new([100.0, -40.0, 7.0], 0.25);
const CLOCK: Clock = Clock::new(12.0, 0.1, 40.0);
const TIMES: [f64; 4] = [10.0, 11.33, 12.0, 14.0];

fn placement() -> Placement {
    Placement {
        offset: DVec3::from_array(NORMALIZATION.offset),
        scale: 1.0,
        rotation: DQuat::from_xyzw(0.3, -0.5, 0.1, 0.7).normalize(),
    }
}

fn initial(len: usize, size: f32, seed: u64) -> InitialGaussians {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut gaussians = InitialGaussians::default();
    for _ in 0..len {
        let mut signs = |size: f32| random.random_range(-size..size);
        let place = [0, 1, 2].map(|_| signs(size));
        let colour = [0, 1, 2].map(|_| 0.5 + signs(0.5));
        gaussians.push_isotropic(place, 0.05 * size, colour, 0.6 + signs(0.3));
        let rotation = [0, 1, 2, 3].map(|_| signs(1.0));
        let length = rotation.map(|part| part * part).iter().sum::<f32>().sqrt();
        let last = gaussians.len() - 1;
        gaussians.rotations[last] = rotation.map(|part| part / length);
        gaussians.scales[last] = [0.05 * size, 0.01 * size, 0.1 * size];
    }
    gaussians
}

fn static_part(degree: usize) -> Part {
    let mut table = table(&initial(40, 2.0, 1), degree);
    let mut random = Pcg64Mcg::seed_from_u64(2);
    if degree > 0 {
        let rest = &mut table.arrays[static_gaussians::SH_REST].values;
        rest.fill_with(|| random.random_range(-0.3_f32..0.3));
    }
    Part::new(StaticGaussians, table)
}

fn temporal_part(velocity: VelocityModel, fades: bool, degree: usize) -> Part {
    let time = TimeModel {
        cycle_frames: 25.0,
        lifespans: fades.then_some(LifespanRange {
            least_frames: 0.25,
            largest_frames: 1e6,
        }),
        velocity,
        least_marginal: 0.05,
    };
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let len = 60;
    let times = InitialTimes {
        peaks: (0..len).map(|_| random.random_range(-25.0..25.0)).collect(),
        lifespans: (0..len).map(|n| [3.0, 12.0, 1e6][n % 3]).collect(),
        velocities: (0..len)
            .map(|_| [0, 1, 2].map(|_| random.random_range(-0.05..0.05)))
            .collect(),
    };
    let mut table = time.table(&initial(len, 1.5, 4), &times, degree);
    if let Some(array) = table.position("tangential_velocities") {
        let values = &mut table.arrays[array].values;
        values.iter_mut().for_each(|value| *value *= -0.5);
    }
    let temporal = TemporalGaussians {
        clock: CLOCK,
        time,
        down: [0.0, 0.6, -0.8],
        dynamic_below_staticness: 1.0,
    };
    Part::new(temporal, table)
}

fn tracked_part() -> Part {
    let path = ObjectPath {
        centre: BSpline {
            degree: 3,
            knots: BSpline::uniform_knots(3, 6, 10.5, 14.0),
            coefficients: (0..6)
                .map(|n| {
                    let n = f64::from(n);
                    [100.0 + 3.0 * n, -40.0 + n * n, 7.0 - 0.3 * n]
                })
                .collect(),
        },
        heading_seconds: vec![10.5, 12.2, 14.0],
        headings: vec![3.0, -3.0, -1.0],
    };
    let up = DVec3::new(0.1, 0.2, 1.0).normalize();
    let object = |id, knots| TrackedObject {
        id,
        dimensions: [0.9, 0.4, 0.3],
        path: RigidPath::new(&path, up, 0.45, knots, &NORMALIZATION),
    };
    let mut tracked = TrackedGaussians::new(vec![object(7, 3), object(9, 1)], false);
    for (index, value) in tracked.corrections.array.values.iter_mut().enumerate() {
        *value = 0.1 * (index as f32).sin();
    }
    let numbers: Vec<usize> = (0..50).map(|index| index % 2).collect();
    let table = tracked::table(&initial(50, 0.5, 5), &numbers);
    Part::new(tracked, table)
}

fn decomposed(origin: DirectionOrigin) -> VelocityModel {
    VelocityModel::Decomposed(Decomposition {
        gamma: 0.7,
        form: VelocityForm::Projected,
        origin,
    })
}

fn written(model: &Model) -> Result<WrittenInTime, String> {
    let mut invalid = InvalidGaussians::default();
    let written = write(model, &placement(), &NORMALIZATION, &mut invalid);
    assert_eq!(invalid, InvalidGaussians::default());
    written
}

fn read_back(bytes: &[u8]) -> Result<Model, String> {
    let mut invalid = InvalidGaussians::default();
    from_bytes(Path::new("a.gtime"), bytes, &NORMALIZATION, &mut invalid)
        .map_err(|error| error.to_string())
}

fn activated(model: &mut Model, seconds: f64) -> ActivatedGaussians {
    let mut gaussians = ActivatedGaussians::default();
    let at = Viewpoint::of_moment(seconds);
    model.activate(&at, &TemporalFeatures::default(), &mut gaussians);
    gaussians
}

fn image(model: &Model, seconds: f64) -> Vec<f32> {
    let camera = Camera::Erp(ErpCamera::new(64, 32));
    let centre = DVec3::from_array(NORMALIZATION.offset);
    let pose = Pose::new(DQuat::IDENTITY, centre);
    let view = View::new(camera, &pose, &NORMALIZATION, seconds).expect("a pose");
    let mut renderer = LayerRenderer::new(model.clone(), RenderSettings::new(1e-3));
    renderer.image(&view, Layer::All).data
}

fn assert_same(model: Model) {
    let mut model = model;
    let file = written(&model).expect("closed forms");
    assert_eq!(file.gaussians, model.len() as u64);
    let mut read = read_back(&file.bytes).expect("what was written");
    let spans = [&model, &read].map(|model| model.time_span().map(|span| span.frames.is_some()));
    assert_eq!(spans[0], spans[1]);
    let most = |a: &[f32], b: &[f32]| {
        assert_eq!(a.len(), b.len());
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    for seconds in TIMES {
        let [a, b] = [&mut model, &mut read].map(|model| activated(model, seconds));
        let flat = |places: &[[f32; 3]]| places.as_flattened().to_vec();
        // Absent objects have places of their own.
        let visible = a.opacities.iter().zip(&b.opacities).enumerate();
        for (index, (one, other)) in visible {
            assert!(
                (one - other).abs() < 3e-3,
                "opacity {index} at {seconds}: {one} {other}"
            );
            if *one > 0.0 {
                let apart = most(&a.positions[index], &b.positions[index]);
                assert!(apart < 2e-4, "place {index} at {seconds}: {apart}");
                let dot = (a.rotations[index].iter().zip(&b.rotations[index])).map(|(a, b)| a * b);
                assert!(
                    dot.sum::<f32>().abs() > 1.0 - 1e-5,
                    "rotation {index} at {seconds}"
                );
                let ratio = a.scales[index][1] / b.scales[index][1];
                assert!((ratio - 1.0).abs() < 1e-3, "size {index}: {ratio}");
            }
        }
        assert!(most(&flat(&a.sh_constant), &flat(&b.sh_constant)) < 1e-3);
        assert!(most(&flat(&a.sh_rest), &flat(&b.sh_rest)) < 1e-2);
        let [one, other] = [&model, &read].map(|model| image(model, seconds));
        let squares = one.iter().zip(&other).map(|(a, b)| (a - b).powi(2));
        let error = squares.sum::<f32>() / one.len() as f32;
        assert!(error < 2e-5, "47 dB at {seconds}: {error}");
        assert!(one.iter().any(|value| *value > 0.1), "nothing is seen");
    }
}

#[test]
fn every_closed_form_is_drawn_as_before() {
    for model in [
        vec![static_part(2)],
        vec![temporal_part(VelocityModel::Free, true, 0)],
        vec![
            static_part(3),
            temporal_part(decomposed(DirectionOrigin::World), true, 3),
        ],
        vec![temporal_part(VelocityModel::Free, false, 1), tracked_part()],
        vec![static_part(0), tracked_part()],
    ] {
        assert_same(Model::new(model));
    }
}

#[test]
fn models_without_a_closed_form_are_refused() {
    let part = temporal_part(decomposed(DirectionOrigin::Camera), true, 0);
    let refused = written(&Model::new(vec![part])).expect_err("no closed form");
    assert!(refused.contains("spz-sequence"), "{refused}");
    let file = written(&Model::new(vec![static_part(0), tracked_part()])).expect("closed forms");
    let read = read_back(&file.bytes).expect("what was written");
    let refused = written(&read).expect_err("a copy");
    assert!(refused.contains("already"), "{refused}");
}

#[test]
fn malformed_files_are_one_line() {
    let model = Model::new(vec![static_part(1), tracked_part()]);
    let bytes = written(&model).expect("closed forms").bytes;
    for length in (0..bytes.len()).step_by(37) {
        let refused = read_back(&bytes[..length]).expect_err("cut off");
        assert!(!refused.contains('\n'), "{refused}");
    }
    let (header, compressed) = split(&bytes).expect("what was written");
    let with = |change: &dyn Fn(&mut Header)| {
        let mut other = header.clone();
        change(&mut other);
        let arrays = inflated(compressed, header.array_bytes()).expect("what was written");
        let refused = read_back(&file_bytes(&other, &arrays).expect("memory"));
        refused.map(drop).expect_err("malformed")
    };
    type Change<'a> = &'a dyn Fn(&mut Header);
    let cases: &[(Change<'_>, &str)] = &[
        (&|header| header.version = 2, "version 2"),
        (&|header| header.degree = 4, "degree 4"),
        (&|header| header.degree = 2, "expected 24"),
        (&|header| header.frame.scale = 0.0, "frame"),
        (&|header| header.time.seconds = -1.0, "-1 seconds"),
        (&|header| header.parts.clear(), "no Gaussians"),
        (&|header| header.parts[0].count -= 1, "goes on"),
        (&|header| header.parts[0].count += 1, "is cut off"),
        (&|header| header.parts[0].count = usize::MAX, "memory"),
        (
            &|header| drop(header.parts[0].arrays.remove(2)),
            "no array rotation",
        ),
        (&|header| header.parts[0].arrays[0].low[1] = 1e300, "bounds"),
        (&|header| header.parts[0].arrays[0].high.clear(), "bounds"),
        (
            &|header| header.parts[1].motion = Motion::Static,
            "not of its motion",
        ),
        (
            &|header| {
                if let Motion::Rigid { objects } = &mut header.parts[1].motion {
                    objects.pop();
                }
            },
            "not there",
        ),
        (
            &|header| {
                if let Motion::Rigid { objects } = &mut header.parts[1].motion {
                    objects[0].times[1] = 1e9;
                }
            },
            "do not increase",
        ),
    ];
    for (change, expected) in cases {
        let refused = with(change);
        assert!(refused.contains(expected), "{refused}, not {expected}");
    }
    let mut longer = bytes.clone();
    longer[0] = b'X';
    let refused = read_back(&longer).map(drop).expect_err("another magic");
    assert!(refused.contains("GAUSTIME"), "{refused}");
}

/// The file of `scripts/golden/gaussians_in_time.py`, which follows the specification alone.
#[test]
fn the_file_of_another_writer_moves_as_specified() {
    let bytes = include_bytes!("peer/peer.gtime");
    // Normalized coordinates are those of the file.
    let normalization = Similarity::new([10.0, 20.0, 30.0], 2.0);
    let mut invalid = InvalidGaussians::default();
    let read = from_bytes(Path::new("peer.gtime"), bytes, &normalization, &mut invalid);
    let mut model = read.expect("a valid file");
    let span = model.time_span().expect("motion");
    assert_eq!([span.begin_seconds, span.end_seconds], [5.0, 9.0]);
    let quarter = std::f32::consts::FRAC_1_SQRT_2 * 0.5;
    let fading = (-0.5_f32).exp() * 0.5;
    let way = std::f32::consts::FRAC_1_PI;
    // Number, time, place and opacity.
    for (index, time, place, opacity) in [
        (0, 0.0, [1.0, 0.0, 3.0], 0.75),
        (1, 4.0, [-1.0, 0.5, 4.0], 1.0),
        (2, 2.0, [0.0, 0.0, 5.0], 0.5),
        (2, 3.0, [1.0, 0.0, 4.5], fading),
        (3, 1.5, [0.0, way, 5.0], fading),
        (3, 0.5, [0.0, -way, 5.0], fading),
        (3, 3.0, [0.0, 0.0, 5.0], 0.0),
        (4, 2.0, [1.5 + quarter, 0.0, 2.0 - quarter], 0.5),
        (4, 4.0, [3.0, 0.0, 1.5], 0.5),
        (4, 4.5, [0.5, 0.0, 0.0], 0.0),
    ] {
        let found = activated(&mut model, 5.0 + time);
        let apart = Vec3::from_array(found.positions[index]).distance(Vec3::from_array(place));
        assert!(
            apart < 1e-4,
            "{index} at {time}: {:?}",
            found.positions[index]
        );
        let apart = (found.opacities[index] - opacity).abs();
        assert!(
            apart < 3e-3,
            "{index} at {time}: {}",
            found.opacities[index]
        );
    }
    let found = activated(&mut model, 5.0);
    for (size, expected) in found.scales[0].iter().zip([0.5, 0.25, 0.125]) {
        assert!((size / expected - 1.0).abs() < 1e-3, "{size}");
    }
    assert_eq!(found.sh_degree, 1);
    for (found, expected) in found.sh_rest[2].iter().zip([0.02, 0.03, 0.04]) {
        assert!((found - expected).abs() < 1e-5, "{found}");
    }
    assert_eq!(found.sh_rest[3 * 2], [0.0; 3]);
    assert!((found.sh_constant[0][0] - 1.772_454).abs() < 1e-3);
}
