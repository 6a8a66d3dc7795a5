//! Measurement of camera motion and of dynamic content.
//!
//! The camera's rotation and the parallax of the scene are measured in the frames. With poses and points the speed is
//! measured as well: in scene depths per second, which needs no scale, and in metres per second if the scale is known.
//! The limits of the classes follow the meaning of the words and were checked on a handful of clips. They are recorded
//! beside every value, so that values remain usable with other limits.

use std::path::Path;

use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    layout::{DYNAMIC_MASKS_FILE, DYNAMIC_MASKS_FOLDER, SCENE_FILE},
    points::PointCloud,
    progress::Progress,
    records::{Dynamics, Evidence, Masks, Measured, Scale, Scene, Sequence},
    statistics::{median, quantile},
    store,
};

use crate::{
    error::CurateError,
    motion::{GreySphere, align, explain, flow},
};

/// Limits between classes of motion.
struct Limits {
    /// Turns faster than this are abrupt, degrees per second, 90th percentile.
    extreme_turn: f64,
    /// A camera that rotates no faster than this may be static, degrees per second, median.
    static_turn: f64,
    /// A camera whose surroundings pass no faster than this may be static, degrees per second,
    /// median over the sphere.
    static_parallax: f64,
    /// Surroundings that pass faster than this belong to a fast camera, degrees per second.
    fast_parallax: f64,
    /// Speeds above this are fast, metres per second: faster than people run.
    fast_speed: f64,
    /// Less of the sphere moving than this is a low level of dynamic content.
    low_dynamics: f64,
    /// More than this is a high level.
    high_dynamics: f64,
}

const LIMITS: Limits = Limits {
    extreme_turn: 90.0,
    static_turn: 3.0,
    static_parallax: 0.7,
    fast_parallax: 40.0,
    fast_speed: 6.0,
    low_dynamics: 0.01,
    high_dynamics: 0.05,
};

/// Pairs of frames that are compared at most, spread over the sequence.
const PAIRS: usize = 16;
/// Frames farther apart than this do not show how the camera moves, seconds.
const LARGEST_GAP_SECONDS: f64 = 0.5;
/// Columns of the images that are compared.
const IMAGE_WIDTH: usize = 256;
/// Directions at which flow is measured.
const GRID: ErpCamera = ErpCamera {
    width: 64,
    height: 32,
};
/// Points whose distance is measured at most, per camera.
const DEPTH_SAMPLES: usize = 500;

/// Measured classes; `None` where a class cannot be measured.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Motion {
    /// Ego-motion class.
    pub ego_motion: Option<Measured>,
    /// Level of dynamic content.
    pub dynamics: Option<Dynamics>,
}

/// Values of all pairs of frames.
#[derive(Default)]
struct Values {
    turns: Vec<f64>,
    parallaxes: Vec<f64>,
    dynamic_shares: Vec<f64>,
}

/// Measures a sequence.
///
/// # Errors
/// When a frame or a record cannot be read.
pub fn measure(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Motion, CurateError> {
    if sequence.is_pinhole() {
        progress.note(&format!(
            "{}: motion is not measured: its frames are those of a pinhole, not of the whole sphere",
            sequence.id
        ));
        return Ok(Motion::default());
    }
    let values = compare_frames(folder, sequence, progress)?;
    if values.turns.is_empty() {
        progress.note(&format!(
            "{}: motion is not measured: its frames are more than {LARGEST_GAP_SECONDS} s apart",
            sequence.id
        ));
        return Ok(Motion::default());
    }
    let speed = speed(folder)?;
    Ok(Motion {
        ego_motion: ego_motion(&values, speed),
        dynamics: dynamics(folder, &values)?,
    })
}

fn compare_frames(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Values, CurateError> {
    let entries = &sequence.frames.entries;
    let near: Vec<usize> = (1..entries.len())
        .filter(|&i| entries[i].time_seconds - entries[i - 1].time_seconds <= LARGEST_GAP_SECONDS)
        .collect();
    let pairs = near.len().min(PAIRS);
    let directions: Vec<glam::Vec3> = (0..GRID.height)
        .flat_map(|row| (0..GRID.width).map(move |column| (column, row)))
        .map(|(column, row)| {
            let pixel = glam::dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
            GRID.unproject(pixel).as_vec3()
        })
        .collect();
    let read = |index: usize| -> Result<GreySphere, CurateError> {
        let image = RgbImage::read(&folder.join(&entries[index].file))?;
        let width = IMAGE_WIDTH.min(image.width);
        Ok(GreySphere::new(&image, width))
    };
    let mut values = Values::default();
    progress.begin(&format!("measuring {}", sequence.id), Some(pairs as u64));
    let measured = (0..pairs).try_for_each(|pair| -> Result<(), CurateError> {
        let index = near[pair * near.len() / pairs];
        let seconds = entries[index].time_seconds - entries[index - 1].time_seconds;
        let (from, to) = (read(index - 1)?, read(index)?);
        let rotation = align(&from, &to);
        let flow = flow(&from, &to, rotation, &directions);
        let motion = explain(&flow, from.pixel_radians(0));
        let turn = glam::Quat::from_scaled_axis(-motion.turn) * rotation;
        let (_, angle) = turn.to_axis_angle();
        let angle = f64::from(angle.min(std::f32::consts::TAU - angle));
        values.turns.push(angle.to_degrees() / seconds);
        values
            .parallaxes
            .push(motion.parallax_radians.to_degrees() / seconds);
        let (mut moving, mut seen) = (0.0, 0.0);
        for index in 0..directions.len() {
            if let Some(moves) = motion.is_dynamic(index) {
                let weight = GRID.pixel_solid_angle(index as u32 / GRID.width);
                seen += weight;
                moving += weight * f64::from(u8::from(moves));
            }
        }
        if seen > 0.0 {
            values.dynamic_shares.push(moving / seen);
        }
        progress.advance(1);
        Ok(())
    });
    progress.end();
    measured.map(|()| values)
}

/// Median speed of the posed cameras, with its unit.
struct Speed {
    depths_per_second: Option<f64>,
    metres_per_second: Option<f64>,
}

fn speed(folder: &Path) -> Result<Option<Speed>, CurateError> {
    let path = folder.join(SCENE_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let scene: Scene = store::read_record(&path)?;
    let cloud = match &scene.points {
        Some(file) => PointCloud::read_ply(&folder.join(file))?,
        None => PointCloud::default(),
    };
    let stride = (cloud.len() / DEPTH_SAMPLES).max(1);
    let (mut metric, mut relative) = (Vec::new(), Vec::new());
    for pair in scene.frames.windows(2) {
        let (Some(from), Some(to)) = (&pair[0].pose, &pair[1].pose) else {
            continue;
        };
        let seconds = pair[1].time_seconds - pair[0].time_seconds;
        let speed = from.centre().distance(to.centre()) / seconds;
        metric.push(speed);
        let depths: Vec<f64> = cloud
            .positions
            .iter()
            .step_by(stride)
            .map(|&p| glam::DVec3::from_array(p).distance(from.centre()))
            .collect();
        relative.extend(
            median(&depths)
                .filter(|&depth| depth > 0.0)
                .map(|depth| speed / depth),
        );
    }
    Ok(Some(Speed {
        depths_per_second: median(&relative),
        metres_per_second: median(&metric).filter(|_| scene.scale == Scale::Metres),
    }))
}

fn evidence(test: &str, value: f64, limit: f64, reading: &str) -> Evidence {
    Evidence {
        test: test.to_owned(),
        value,
        limit,
        reading: reading.to_owned(),
    }
}

fn ego_motion(values: &Values, speed: Option<Speed>) -> Option<Measured> {
    let turn = median(&values.turns)?;
    let fast_turn = quantile(&values.turns, 0.9)?;
    let parallax = median(&values.parallaxes)?;
    let metric = speed.as_ref().and_then(|speed| speed.metres_per_second);
    let is_fast = match metric {
        Some(speed) => speed > LIMITS.fast_speed,
        None => parallax > LIMITS.fast_parallax,
    };
    let class = if fast_turn > LIMITS.extreme_turn {
        "extreme"
    } else if is_fast {
        "high-speed"
    } else if turn <= LIMITS.static_turn && parallax <= LIMITS.static_parallax {
        "static"
    } else {
        "walking-and-daily"
    };
    let mut found = vec![
        evidence(
            "turn_p90_degrees_per_second",
            fast_turn,
            LIMITS.extreme_turn,
            "above is extreme",
        ),
        evidence(
            "turn_median_degrees_per_second",
            turn,
            LIMITS.static_turn,
            "above is not static",
        ),
        evidence(
            "parallax_median_degrees_per_second",
            parallax,
            LIMITS.static_parallax,
            "above is not static",
        ),
        evidence(
            "parallax_median_degrees_per_second",
            parallax,
            LIMITS.fast_parallax,
            "above is high-speed where no speed is known",
        ),
    ];
    if let Some(speed) = metric {
        found.push(evidence(
            "metres_per_second",
            speed,
            LIMITS.fast_speed,
            "above is high-speed",
        ));
    }
    let relative = speed.and_then(|speed| speed.depths_per_second);
    if let Some(speed) = relative {
        // The same limit as an angular speed of the surroundings.
        let limit = LIMITS.fast_parallax.to_radians();
        found.push(evidence(
            "depths_per_second",
            speed,
            limit,
            "for information",
        ));
    }
    Some(Measured {
        class: class.to_owned(),
        from: if relative.is_some() {
            "frames and poses"
        } else {
            "frames"
        }
        .to_owned(),
        evidence: found,
    })
}

/// Measures from the masks of the sequence, else from the residual flow.
fn dynamics(folder: &Path, values: &Values) -> Result<Option<Dynamics>, CurateError> {
    let record = folder.join(DYNAMIC_MASKS_FOLDER).join(DYNAMIC_MASKS_FILE);
    let (shares, from) = if record.is_file() {
        let masks: Masks = store::read_record(&record)?;
        (
            masks
                .frames
                .iter()
                .map(|frame| frame.dynamic_share)
                .collect(),
            "masks",
        )
    } else {
        (values.dynamic_shares.clone(), "frames")
    };
    if shares.is_empty() {
        return Ok(None);
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let class = match mean {
        share if share > LIMITS.high_dynamics => "high",
        share if share > LIMITS.low_dynamics => "medium",
        _ => "low",
    };
    Ok(Some(Dynamics {
        class: class.to_owned(),
        from: from.to_owned(),
        evidence: vec![
            evidence(
                "dynamic_share_mean",
                mean,
                LIMITS.low_dynamics,
                "above is medium",
            ),
            evidence(
                "dynamic_share_mean",
                mean,
                LIMITS.high_dynamics,
                "above is high",
            ),
        ],
    }))
}
