//! Agreement of the sample's poses, points, masks and video through this workspace's own decoder and cameras. Points
//! projected from a frame's pose have the colours of their pixels. A mirrored image, an inverted pose or a grid that
//! is a pixel off shows here.

use std::{collections::HashMap, error::Error, path::PathBuf};

use omnilife_schemas::{
    Pose,
    camera::{CameraModel, ErpCamera},
    points::PointCloud,
    records::poses::Poses,
    rgb::Mask,
    store,
};
use omnilife_video::{Converter, Scaling, VideoReader};

const CAMERA: ErpCamera = ErpCamera::new(512, 256);
/// Side of a cell in pixels; the nearest of all points in a cell is taken as the visible one.
const CELL_PIXELS: usize = 4;

fn sample() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/street")
}

/// Converts world to camera, written out from the quaternion: `R^T (x - centre)`.
fn to_camera(pose: &Pose, world: [f64; 3]) -> [f64; 3] {
    let [w, x, y, z] = pose.rotation_wxyz;
    let rotation = [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ];
    let relative = [0, 1, 2].map(|axis| world[axis] - pose.centre[axis]);
    [0, 1, 2].map(|column| {
        (0..3)
            .map(|row| rotation[row][column] * relative[row])
            .sum()
    })
}

/// Returns column, row and index of every point that is the nearest in its cell and not on a moving object.
fn visible_points(pose: &Pose, points: &PointCloud, mask: &Mask) -> Vec<(usize, usize, usize)> {
    let mut nearest = HashMap::new();
    for (index, &position) in points.positions.iter().enumerate() {
        let local = to_camera(pose, position);
        let Some(pixel) = CAMERA.project(local.into()) else {
            continue;
        };
        let (column, row) = (pixel.x as usize, (pixel.y as usize).min(255));
        let distance: f64 = local.iter().map(|value| value * value).sum();
        let cell = nearest
            .entry((column / CELL_PIXELS, row / CELL_PIXELS))
            .or_insert((distance, (column, row, index)));
        if distance < cell.0 {
            *cell = (distance, (column, row, index));
        }
    }
    nearest
        .into_values()
        .map(|(_, point)| point)
        .filter(|&(column, row, _)| mask.data[row * mask.width + column] == 0)
        .collect()
}

fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let count = pairs.len() as f64;
    let mean_a = pairs.iter().map(|pair| pair.0).sum::<f64>() / count;
    let mean_b = pairs.iter().map(|pair| pair.1).sum::<f64>() / count;
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        ab += (a - mean_a) * (b - mean_b);
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
    }
    ab / (aa * bb).sqrt()
}

#[test]
fn points_have_the_colours_of_the_pixels_they_project_to() -> Result<(), Box<dyn Error>> {
    let folder = sample();
    let poses: Poses = store::read_record(&folder.join("poses.json"))?;
    let points = PointCloud::read_ply(&folder.join("points.ply"))?;
    assert_eq!((poses.frames.len(), points.len()), (60, 20_000));

    let video = folder.join("street.mp4");
    let mut reader = VideoReader::open(&video)?;
    let mut converter = Converter::new(Scaling::Native);
    let mut decoded = 0;
    while let Some(frame) = reader.next_frame()? {
        let posed = &poses.frames[decoded];
        decoded += 1;
        assert!((frame.time_seconds - posed.time_seconds).abs() < 1e-9);
        if (decoded - 1) % 15 != 0 {
            continue;
        }
        let image = converter.convert(&video, &frame.image)?;
        assert_eq!((image.width, image.height), (512, 256));
        let mask = Mask::read(&folder.join(posed.mask.as_ref().ok_or("a frame has no mask")?))?;
        assert_eq!((mask.width, mask.height), (512, 256));
        let visible = visible_points(&posed.pose, &points, &mask);
        // Correlation after moving every point by a map of pixels.
        let agreement = |moved: &dyn Fn(usize, usize) -> (usize, usize)| {
            let pairs: Vec<(f64, f64)> = visible
                .iter()
                .flat_map(|&(column, row, index)| {
                    let (x, y) = moved(column, row);
                    let pixel = image.pixel(x % 512, y.min(255));
                    let colour = points.colours[index];
                    [0, 1, 2].map(|c| (f64::from(pixel[c]), f64::from(colour[c])))
                })
                .collect();
            correlation(&pairs)
        };
        let matched = agreement(&|x, y| (x, y));
        let mirrored = agreement(&|x, y| (511 - x, y));
        let shifted = [
            agreement(&|x, y| (x + 1, y)),
            agreement(&|x, y| (x + 511, y)),
            agreement(&|x, y| (x, y + 1)),
            agreement(&|x, y| (x, y.saturating_sub(1))),
        ];
        println!("{matched:.3}, mirrored {mirrored:.3}, shifted {shifted:.3?}");
        assert!(matched > 0.9, "frame {}: {matched}", decoded - 1);
        assert!(mirrored < 0.6, "frame {}: {mirrored}", decoded - 1);
        assert!(
            shifted.iter().all(|&other| other < matched - 0.02),
            "{shifted:?}"
        );
    }
    assert_eq!(decoded, 60);
    Ok(())
}
