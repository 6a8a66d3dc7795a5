//! A painted vehicle on a painted ground, seen from above in closed form, with its true path and a given one beside it.

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};
use omnilife_engine::{camera::View, training_view::TrainingView};
use omnilife_reconstruct::scene::TrainingScene;
use omnilife_schemas::{
    Pose, Similarity,
    camera::{Camera, CameraModel, PinholeCamera},
    oriented_box::OrientedBox,
    points::PointCloud,
    records::{Track, Tracks},
    trajectory::{BSpline, GroundAxes, ObjectPath},
};

/// Sides of the vehicle, metres.
const DIMENSIONS: [f64; 3] = [4.5, 1.8, 1.5];
/// Views of the flight, one a second.
const VIEWS: u32 = 16;
/// Height of the camera, metres.
const HEIGHT: f64 = 50.0;
/// Normalized units of a metre.
const SCALE: f64 = 0.04;
/// Those of a scene whose camera hovers: points are a thousand away.
const HOVERING_SCALE: f64 = 1000.0 / HEIGHT;
/// Samples along a side of a pixel.
const SAMPLES: u32 = 2;

/// Returns the true path of the vehicle, which drives a bend.
pub(crate) fn true_path() -> ObjectPath {
    let place = |number: u32| {
        let at = f64::from(number);
        [-9.0 + 2.6 * at, -3.0 + 0.16 * at * at, 0.5 * DIMENSIONS[2]]
    };
    let centre = BSpline {
        degree: 3,
        knots: BSpline::uniform_knots(3, 8, 0.0, f64::from(VIEWS - 1)),
        coefficients: (0..8).map(place).collect(),
    };
    let axes = GroundAxes::new(DVec3::Z);
    let heading_seconds: Vec<f64> = (0..VIEWS).map(f64::from).collect();
    let headings = heading_seconds.iter();
    let headings = headings.map(|&at| axes.heading(centre.velocity(at)));
    ObjectPath {
        headings: headings.collect(),
        heading_seconds,
        centre,
    }
}

/// Returns the path with an error of up to about `sway` metres, and of three tenths of that in radians.
pub(crate) fn path_beside(sway: f64) -> ObjectPath {
    let mut path = true_path();
    for (number, coefficient) in (0_u32..).zip(&mut path.centre.coefficients) {
        let at = f64::from(number);
        coefficient[0] += sway * (1.3 * at).sin();
        coefficient[1] += sway * (1.1 * at + 0.6).cos();
    }
    for (heading, at) in path.headings.iter_mut().zip(&path.heading_seconds) {
        *heading += 0.3 * sway * (0.7 * at).sin();
    }
    path
}

/// Returns the flight with the vehicle on its true path in the images, and on `given` in the tracks.
pub(crate) fn scene(given: ObjectPath) -> TrainingScene {
    scene_of(given, SCALE, true, |at| {
        (looks_down(), dvec3(0.3 * at - 2.0, 0.1 * at, HEIGHT))
    })
}

/// Returns the same from a camera that hovers and turns, at the size at which a scene of its points is loaded; on
/// request without the vehicle in the images.
pub(crate) fn hovering(given: ObjectPath, shows_vehicle: bool) -> TrainingScene {
    scene_of(given, HOVERING_SCALE, shows_vehicle, |at| {
        let turn = DMat3::from_rotation_z(0.01 * at) * looks_down();
        let to_world = turn * DMat3::from_rotation_x(0.02 * at.sin());
        (to_world, dvec3(0.0, 0.0, HEIGHT))
    })
}

/// Returns the rotation of a camera that looks straight down.
fn looks_down() -> DMat3 {
    DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z)
}

/// Returns the scene of cameras (to the world) and their centres by the time.
fn scene_of(
    given: ObjectPath,
    scale: f64,
    shows_vehicle: bool,
    camera_at: impl Fn(f64) -> (DMat3, DVec3),
) -> TrainingScene {
    let camera: Camera = PinholeCamera::with_horizontal_field_of_view(192, 108, 0.7).into();
    let normalization = Similarity::new([0.0, 0.0, HEIGHT], scale);
    let truth = true_path();
    let views = (0..VIEWS).map(|frame| {
        let at = f64::from(frame);
        let (to_world, centre) = camera_at(at);
        let pose = Pose::new(DQuat::from_mat3(&to_world), centre);
        TrainingView {
            frame,
            view: View::new(camera, &pose, &normalization, at).unwrap(),
            pixels: image(
                camera,
                to_world,
                centre,
                shows_vehicle.then(|| vehicle(&truth, at)).as_ref(),
            ),
            mask: None,
            ignored: None,
        }
    });
    let (novel_views, input_views) = views.partition(|view: &TrainingView| view.frame % 5 == 4);
    let (mut positions, mut colours) = (Vec::new(), Vec::new());
    for number in 0..24 * 16 {
        let at = 1.5 * dvec2(f64::from(number % 24) - 11.5, f64::from(number / 24) - 7.5);
        positions.push(normalization.normalize(at.extend(0.0)).as_vec3().to_array());
        colours.push(ground(at).map(|level| level as u8));
    }
    let track = Track {
        id: 3,
        class: "vehicle".to_owned(),
        dimensions: DIMENSIONS,
        path: given,
        detections: 12,
        displacement: 15.0,
    };
    let mut scene = TrainingScene::new("flight", camera, input_views, normalization);
    scene.novel_views = novel_views;
    scene.points = PointCloud { positions, colours };
    scene.tracks = Some(Tracks {
        scene: scene.id.clone(),
        frames: scene.input_views.iter().map(|view| view.frame).collect(),
        image_size: [192, 108],
        up: [0.0, 0.0, 1.0],
        metres_per_unit: 1.0,
        stages: Vec::new(),
        detections: Vec::new(),
        tracks: vec![track],
        warnings: Vec::new(),
    });
    scene
}

fn vehicle(path: &ObjectPath, seconds: f64) -> OrientedBox {
    let (centre, heading) = path.at(seconds).unwrap();
    OrientedBox {
        centre,
        axes: GroundAxes::new(DVec3::Z).rotation(heading),
        half: 0.5 * DVec3::from_array(DIMENSIONS),
    }
}

fn image(camera: Camera, to_world: DMat3, centre: DVec3, vehicle: Option<&OrientedBox>) -> Vec<u8> {
    let [width, height] = camera.size();
    let mut pixels = Vec::with_capacity(3 * width * height);
    for pixel in 0..width * height {
        let corner = dvec2((pixel % width) as f64, (pixel / width) as f64);
        let mut sum = DVec3::ZERO;
        for sample in 0..SAMPLES * SAMPLES {
            let inner = dvec2(f64::from(sample % SAMPLES), f64::from(sample / SAMPLES));
            let at = corner + (inner + 0.5) / f64::from(SAMPLES);
            sum += DVec3::from_array(seen(centre, to_world * camera.unproject(at), vehicle));
        }
        let mean = sum / f64::from(SAMPLES * SAMPLES);
        pixels.extend(mean.to_array().map(|level| level.round() as u8));
    }
    pixels
}

/// Returns the levels of a ray from the camera.
fn seen(centre: DVec3, ray: DVec3, vehicle: Option<&OrientedBox>) -> [f64; 3] {
    let crossing = vehicle.and_then(|vehicle| Some((vehicle, vehicle.crossing(centre, ray)?)));
    match crossing {
        Some((vehicle, [distance, _])) => {
            let own = vehicle.axes.transpose() * (centre + ray * distance - vehicle.centre);
            paint(own.truncate())
        }
        None => ground((centre - ray * (centre.z / ray.z)).truncate()),
    }
}

fn paint(at: DVec2) -> [f64; 3] {
    [
        130.0 + 80.0 * (2.1 * at.x + 0.4 * at.y).sin(),
        120.0 + 90.0 * (at.x + 3.9 * at.y).sin(),
        140.0 + 70.0 * (1.7 * at.x - 2.0 * at.y).cos(),
    ]
}

fn ground(at: DVec2) -> [f64; 3] {
    let level = 90.0 + 12.0 * (0.9 * at.x).sin() + 12.0 * (1.1 * at.y).sin();
    [level, level + 6.0, level - 4.0]
}
