//! Sequences of KITTI tracking (`readme.txt` of its devkit; that of the raw data for the unit of `oxts`).
//!
//! ```text
//! calib/0004.txt                   P0 to P3 (3x4), R_rect (3x3), Tr_velo_cam, Tr_imu_velo (3x4)
//! image_02/0004/000000.png         left colour camera, image_03 the right one; rectified, 10 Hz
//! velodyne/0004/000000.bin         x, y, z, reflectance, 32-bit floats
//! label_02/0004.txt                frame, id, type, truncated, occluded, alpha, 4 of a 2D box, height, width, length,
//!                                  x, y, z, rotation_y; results have a score
//! oxts/0004.txt                    latitude, longitude, altitude, roll, pitch, yaw and 24 others, a line a frame
//! ```
//!
//! A LiDAR point is at `P2 R_rect Tr_velo_cam x` in the left colour image: `P2 = K [I | t]` acts on the rectified
//! frame of camera 0 (x right, y down, z forward). `Tr_imu_velo` maps the IMU (x forward, y left, z up) to the LiDAR.
//! Oxts map the IMU to the world: Mercator metres at the scale of the first latitude, `Rz(yaw) Ry(pitch) Rx(roll)`, x
//! east, y north, z up. Here the world begins at the first place. A box stands on its location in the rectified frame
//! of camera 0; its length is along x at `rotation_y` 0. Pixels of the files have their centres at whole numbers, ours
//! at halves.
//!
//! Files have no times: the sequences are synchronized at 10 Hz. Labels of older devkits call the matrices `R0_rect`,
//! `Tr_velo_to_cam` and `Tr_imu_to_velo`.

mod calibration;
mod oxts;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3};
use omnilife_schemas::{
    image_file::ImageFile,
    oriented_box::OrientedBox,
    records::ObjectClass,
    store::{self, StoreError},
};

use self::calibration::Calibration;
use super::{
    Layout, RigCamera, RigImage, Sweep, choice::Choice, objects::LabelledObject, parts_left_out,
    rigid::Rigid, table,
};
use crate::{
    error::CurateError,
    exchange::{ForeignScene, Format, file_name, left_out},
    frame_order,
};

/// The format.
pub const FORMAT: Format = Format {
    id: "kitti-tracking",
    about: "a sequence of KITTI tracking (FOLDER/0004, FOLDER/0004/image_02): calib/, image_02/, velodyne/, label_02/, \
            oxts/",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const CALIBRATION_FOLDER: &str = "calib";
const LABEL_FOLDER: &str = "label_02";
const LIDAR_FOLDER: &str = "velodyne";
const OXTS_FOLDER: &str = "oxts";
/// Folders of the cameras, by their number.
const CAMERAS: [&str; 4] = ["image_00", "image_01", "image_02", "image_03"];
/// Number of the first colour camera; the others before it are grey.
const FIRST_COLOUR_CAMERA: usize = 2;
/// Frames per second of the synchronized sequences.
const RATE: f64 = 10.0;
/// Floats of a LiDAR point.
const VALUES: usize = 4;

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let is_root = |folder: &Path| folder.join(CALIBRATION_FOLDER).is_dir();
    let choice = Choice::read(folder, is_root, "calib/, as KITTI tracking does")?;
    let root = choice.root.as_path();
    let sequence = choice.sequence(&sequences(root)?)?;
    let calibration =
        Calibration::read(&root.join(format!("{CALIBRATION_FOLDER}/{sequence}.txt")))?;
    let known = CAMERAS.map(str::to_owned);
    let usual = CAMERAS.iter().skip(FIRST_COLOUR_CAMERA);
    let usual = usual.filter(|name| root.join(name).join(&sequence).is_dir());
    let chosen = choice.cameras(&known, usual.map(|&name| name.to_owned()).collect())?;
    let vehicle = oxts::read(&root.join(format!("{OXTS_FOLDER}/{sequence}.txt")))?;
    let to_world = |frame: u64| world_from_rectified(&vehicle, &calibration, frame);
    let (mut cameras, mut images) = (Vec::new(), Vec::new());
    for name in chosen {
        let files = frame_order::images_in(&root.join(&name).join(&sequence))?;
        let Some(first) = files.first() else {
            let reason = format!("must hold images of {name}/{sequence}, got none");
            return Err(CurateError::input(root, reason));
        };
        let number = CAMERAS.iter().position(|camera| *camera == name);
        let camera = number.and_then(|number| calibration.cameras.get(number));
        let (camera, place) = camera
            .ok_or_else(|| CurateError::input(root, format!("must calibrate {name}")))?
            .sized(ImageFile::open(first)?.shown_size()?);
        for file in files {
            let frame = frame_order::number(&file)
                .ok_or_else(|| CurateError::input(&file, "must have its number for a name"))?;
            let rectified = to_world(frame).map_err(|reason| CurateError::input(&file, reason))?;
            let to_rectified = Rigid {
                rotation: DMat3::IDENTITY,
                translation: place,
            };
            let pose = rectified.after(to_rectified).pose();
            images.push(RigImage {
                pose: pose.ok_or_else(|| CurateError::input(&file, "must have a finite pose"))?,
                file,
                camera: cameras.len(),
                seconds: seconds(frame),
                moment: frame,
            });
        }
        cameras.push(RigCamera {
            name,
            camera: camera.into(),
        });
    }
    let mut notes = vec![format!(
        "times count {RATE} frames per second, at which the sequences are synchronized; a LiDAR sweep counts as taken at \
         one moment"
    )];
    let frames: Vec<u64> = images.iter().map(|image| image.moment).collect();
    let mut sweeps = Vec::new();
    for (frame, file) in sweep_files(
        &root.join(LIDAR_FOLDER).join(&sequence),
        &frames,
        &mut notes,
    )? {
        let rectified = to_world(frame).map_err(|reason| CurateError::input(&file, reason))?;
        sweeps.push(Sweep {
            file,
            to_world: rectified.after(calibration.rectified_from_lidar),
            seconds: seconds(frame),
            moment: frame,
            values: VALUES,
        });
    }
    let labels = root.join(format!("{LABEL_FOLDER}/{sequence}.txt"));
    let objects = labelled(&labels, &to_world, &mut notes)?;
    let others = CAMERAS
        .into_iter()
        .filter(|name| !cameras.iter().any(|one| one.name == **name));
    let (others, missing): (Vec<&str>, Vec<&str>) =
        others.partition(|name| root.join(name).join(&sequence).is_dir());
    let colour = CAMERAS.iter().skip(FIRST_COLOUR_CAMERA);
    let missing = colour.filter(|name| missing.contains(*name));
    notes.extend(missing.map(|name| format!("no {name} of the sequence")));
    let others: Vec<(&str, &str)> = (others.into_iter())
        .map(|name| (name, "a camera that is not chosen"))
        .collect();
    notes.extend(parts_left_out(root, &others));
    Layout {
        format: FORMAT.id,
        root,
        cameras,
        images,
        sweeps,
        objects,
        label_reach_seconds: 0.0,
        missing_images: Vec::new(),
        notes,
    }
    .scene()
}

/// Returns the names of the sequences with a calibration, in order.
fn sequences(root: &Path) -> Result<Vec<String>, StoreError> {
    let mut names = store::names_in(&root.join(CALIBRATION_FOLDER))?;
    names.retain(|name| name.ends_with(".txt") && !store::is_hidden(Path::new(name)));
    names.sort();
    let stems = names
        .iter()
        .map(|name| crate::exchange::stem(name).to_owned());
    Ok(stems.collect())
}

/// Returns the time of a frame.
fn seconds(frame: u64) -> f64 {
    frame as f64 / RATE
}

/// Returns the transform from the rectified frame of camera 0 to the world in a frame.
fn world_from_rectified(
    vehicle: &[Rigid],
    calibration: &Calibration,
    frame: u64,
) -> Result<Rigid, String> {
    let of_frame = usize::try_from(frame).ok();
    let vehicle_pose = of_frame
        .and_then(|frame| vehicle.get(frame))
        .ok_or_else(|| {
            format!(
                "must have a line of {OXTS_FOLDER} for frame {frame}, got {}",
                vehicle.len()
            )
        })?;
    let imu_from_lidar = calibration.lidar_from_imu.inverse();
    let lidar_from_rectified = calibration.rectified_from_lidar.inverse();
    Ok(vehicle_pose
        .after(imu_from_lidar)
        .after(lidar_from_rectified))
}

/// Returns the sweeps of frames, each once, and reports frames without one.
///
/// # Errors
/// When the folder cannot be listed, or two files have one number.
fn sweep_files(
    folder: &Path,
    frames: &[u64],
    notes: &mut Vec<String>,
) -> Result<BTreeMap<u64, PathBuf>, CurateError> {
    if !folder.is_dir() {
        notes.push(format!(
            "no {LIDAR_FOLDER}: the scene has neither points nor distances"
        ));
        return Ok(BTreeMap::new());
    }
    let mut files = store::paths_in(folder)?;
    files.retain(|file| !store::is_hidden(file) && frame_order::has_extension(file, &["bin"]));
    let (mut sweeps, mut others) = (BTreeMap::<u64, PathBuf>::new(), Vec::new());
    for file in files {
        let number = frame_order::number(&file);
        let Some(frame) = number.filter(|frame| frames.contains(frame)) else {
            others.push(file_name(&file.to_string_lossy()));
            continue;
        };
        if let Some(known) = sweeps.get(&frame) {
            let reason = format!(
                "must be the one sweep of frame {frame}, got {} too",
                known.display()
            );
            return Err(CurateError::input(&file, reason));
        }
        sweeps.insert(frame, file);
    }
    let mut without = frames.to_vec();
    without.sort_unstable();
    without.dedup();
    without.retain(|frame| !sweeps.contains_key(frame));
    let without: Vec<String> = without.iter().map(u64::to_string).collect();
    notes.extend(left_out::line(&without, "frames without a LiDAR sweep"));
    notes.extend(left_out::line(
        &others,
        "LiDAR sweeps without an image, left out",
    ));
    Ok(sweeps)
}

/// Reads the labelled objects in the world.
///
/// # Errors
/// When a line has another width, a number that is not finite, a frame before that of the line above, or another type
/// than its track.
fn labelled(
    path: &Path,
    to_world: &impl Fn(u64) -> Result<Rigid, String>,
    notes: &mut Vec<String>,
) -> Result<Vec<LabelledObject>, StoreError> {
    if !path.is_file() {
        notes.push(format!(
            "no {LABEL_FOLDER} of the sequence: nothing is labelled"
        ));
        return Ok(Vec::new());
    }
    let (objects, found) = objects_of(&table::text(path)?, to_world)
        .map_err(|reason| StoreError::malformed(path, reason))?;
    notes.extend(found);
    Ok(objects)
}

/// Reads the text of labels as [`labelled`] does; returns lines on what is left out too.
fn objects_of(
    text: &str,
    to_world: &impl Fn(u64) -> Result<Rigid, String>,
) -> Result<(Vec<LabelledObject>, Vec<String>), String> {
    let mut objects: BTreeMap<u32, LabelledObject> = BTreeMap::new();
    let mut kinds: BTreeMap<u32, &str> = BTreeMap::new();
    let (mut last, mut without_care, mut unknown) = (0_u64, 0_usize, Vec::new());
    for (line, text) in table::lines(text) {
        let words: Vec<&str> = text.split_whitespace().collect();
        let ([frame, id, kind, values @ ..], 17 | 18) = (words.as_slice(), words.len()) else {
            return Err(format!(
                "line {line} must hold 17 columns, or 18 with a score, got {}",
                words.len()
            ));
        };
        let frame: u64 = (frame.parse())
            .map_err(|_| format!("line {line} must begin with a frame number, got {frame:?}"))?;
        if frame < last {
            return Err(format!(
                "frames must rise, got frame {frame} at line {line} after frame {last}"
            ));
        }
        last = frame;
        let values = table::numbers(values.iter().copied(), line)?;
        if *kind == "DontCare" {
            without_care = without_care.saturating_add(1);
            continue;
        }
        let id: u32 = (id.parse())
            .map_err(|_| format!("line {line} must have the number of a track, got {id:?}"))?;
        let known = *kinds.entry(id).or_insert(*kind);
        if known != *kind {
            return Err(format!(
                "line {line} must have the type of track {id} above, {known}, got {kind}"
            ));
        }
        let in_camera = box_of(&values, line)?;
        let rectified = to_world(frame).map_err(|reason| format!("line {line}: {reason}"))?;
        let class = class_of(kind).unwrap_or_else(|| {
            unknown.push((*kind).to_owned());
            ObjectClass::Other
        });
        let object = objects.entry(id).or_insert_with(|| LabelledObject {
            name: None,
            id,
            class,
            boxes: Vec::new(),
        });
        if object
            .boxes
            .last()
            .is_some_and(|(time, _)| *time >= seconds(frame))
        {
            return Err(format!(
                "line {line} is the second box of track {id} in frame {frame}"
            ));
        }
        let in_world = OrientedBox {
            centre: rectified.apply(in_camera.centre),
            axes: rectified.rotation * in_camera.axes,
            half: in_camera.half,
        };
        object.boxes.push((seconds(frame), in_world));
    }
    unknown.sort();
    unknown.dedup();
    let mut notes = Vec::new();
    notes.extend(
        (without_care > 0).then(|| {
            format!("labels of regions without care (DontCare), left out: {without_care}")
        }),
    );
    notes.extend(left_out::line(
        &unknown,
        "types of labels that become class other",
    ));
    notes.extend((!objects.is_empty()).then(|| {
        "2D boxes of the labels are left out: those of the scene are projections of the 3D boxes".to_owned()
    }));
    Ok((objects.into_values().collect(), notes))
}

/// Returns the box of a label in the rectified frame of camera 0, from the columns after the type.
fn box_of(values: &[f64], line: usize) -> Result<OrientedBox, String> {
    let [
        _,
        _,
        _,
        _,
        _,
        _,
        _,
        height,
        width,
        length,
        x,
        y,
        z,
        turn,
        ..,
    ] = *values
    else {
        return Err(format!("line {line} must hold a box"));
    };
    let sides = DVec3::new(length, width, height);
    if sides.min_element() <= 0.0 {
        return Err(format!(
            "line {line} must have a height, width and length above 0, got {height}, {width} and {length}"
        ));
    }
    let forward = DMat3::from_rotation_y(turn) * DVec3::X;
    let up = DVec3::NEG_Y;
    Ok(OrientedBox {
        centre: DVec3::new(x, y, z) + 0.5 * height * up,
        axes: DMat3::from_cols(forward, up.cross(forward), up),
        half: 0.5 * sides,
    })
}

/// Returns the class of a type of label; `None` for an unknown one.
fn class_of(kind: &str) -> Option<ObjectClass> {
    match kind {
        "Car" | "Van" | "Truck" | "Tram" => Some(ObjectClass::Vehicle),
        "Pedestrian" | "Person" | "Person_sitting" | "Cyclist" => Some(ObjectClass::Person),
        "Misc" => Some(ObjectClass::Other),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(frame: u32, id: u32, x: f64, turn: f64) -> String {
        format!("{frame} {id} Car 0 0 -1.5 10 20 30 40 1.5 1.6 4.0 {x} 1.7 12 {turn}\n")
    }

    fn resting(_frame: u64) -> Result<Rigid, String> {
        Ok(Rigid {
            rotation: DMat3::IDENTITY,
            translation: DVec3::ZERO,
        })
    }

    #[test]
    fn a_box_stands_on_its_location_and_turns_about_the_axis_down() {
        let labels = line(0, 3, 2.0, 0.3)
            + "0 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n";
        let Ok((objects, notes)) = objects_of(&labels, &resting) else {
            panic!("sound labels are read");
        };
        assert!(notes[0].contains("DontCare"), "{notes:?}");
        let one = &objects[0].boxes[0].1;
        assert!(one.centre.distance(DVec3::new(2.0, 0.95, 12.0)) < 1e-12);
        assert_eq!(one.half.to_array(), [2.0, 0.8, 0.75]);
        // The devkit's matrix [c 0 s; 0 1 0; -s 0 c] on the middle of the front, (length / 2, -height / 2, 0).
        let (sine, cosine) = 0.3_f64.sin_cos();
        let front = DVec3::new(2.0 + 2.0 * cosine, 0.95, 12.0 - 2.0 * sine);
        assert!((one.centre + one.axes.x_axis * one.half.x).distance(front) < 1e-12);
        assert!((one.axes.determinant() - 1.0).abs() < 1e-12);
        assert_eq!(one.axes.z_axis, DVec3::NEG_Y);
    }

    #[test]
    fn sweeps_without_a_frame_are_listed_and_two_of_one_are_refused()
    -> Result<(), Box<dyn std::error::Error>> {
        let temp = tempfile::tempdir()?;
        for name in ["000000.bin", "000002.bin", "notes.bin"] {
            store::write_bytes(&temp.path().join(name), &[])?;
        }
        let mut notes = Vec::new();
        let sweeps = sweep_files(temp.path(), &[0, 1], &mut notes);
        assert!(sweeps.is_ok_and(|sweeps| sweeps.len() == 1 && sweeps.contains_key(&0)));
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert!(notes[1].contains("2 (000002.bin, notes.bin)"), "{notes:?}");
        store::write_bytes(&temp.path().join("0.bin"), &[])?;
        let two = sweep_files(temp.path(), &[0, 1], &mut notes);
        assert!(two.is_err_and(|error| error.to_string().contains("one sweep of frame 0")));
        Ok(())
    }

    #[test]
    fn lines_of_another_width_order_or_number_are_refused_with_their_place() {
        let good = line(2, 3, 2.0, 0.3);
        assert!(objects_of(&good, &resting).is_ok());
        assert!(objects_of(&good.replace("0.3", "0.3 0.9"), &resting).is_ok());
        for (bad, told) in [
            (good.replace(" 12 ", " "), "got 16"),
            (good.replace("0.3", "0.3 0.9 1"), "got 19"),
            (good.replace(" 12 ", " nan "), "\"nan\""),
            (good.replace(" 1.6 ", " 0 "), "above 0"),
            (good.clone() + &good, "second box"),
            (
                good.clone() + &line(3, 3, 2.0, 0.3).replace("Car", "Van"),
                "Car, got Van",
            ),
            (good.clone() + &line(1, 4, 0.0, 0.0), "after frame 2"),
        ] {
            let Err(reason) = objects_of(&bad, &resting) else {
                panic!("{bad} is read");
            };
            assert!(
                reason.contains(told) && reason.contains("line "),
                "{reason}"
            );
        }
    }
}
