//! Labelled boxes of a drive: paths of moving objects, and boxes in images.
//!
//! The objects of a scene are its dynamic region, and the static scene is learnt from the other pixels. So boxes of
//! parked cars are not taken, and their points stay in the scene.

use glam::{DVec2, DVec3};
use omnilife_schemas::{
    camera::{CameraModel, PinholeCamera},
    oriented_box::OrientedBox,
    plain_text,
    records::{ObjectClass, Track},
    statistics::median,
    trajectory::{BSpline, GroundAxes, ObjectPath},
};

/// Displacement from which on an object moves, metres. Labels of parked cars wander by some decimetres.
const LEAST_DISPLACEMENT_METRES: f64 = 1.0;
/// Tilt of a box from upright that is reported, degrees.
const REPORTED_TILT_DEGREES: f64 = 1.0;
/// Distance in front of a camera at which edges of boxes are cut, metres.
const NEAR_METRES: f64 = 0.1;
/// Usual steps between labels from which on an object has a gap.
const GAP_STEPS: f64 = 1.5;
/// Smallest side of a box in an image, pixels.
pub(super) const LEAST_SIDE_PIXELS: f64 = 1.0;
/// Upward direction of the worlds of both layouts.
pub(super) const UP: DVec3 = DVec3::Z;

#[derive(Debug, Clone)]
pub(super) struct LabelledObject {
    /// Unique in the drive.
    pub(super) id: u32,
    /// Name in the labels, where that is not the id.
    pub(super) name: Option<String>,
    pub(super) class: ObjectClass,
    /// Boxes in the world by their seconds, which rise. Their axes are forward, left and up.
    pub(super) boxes: Vec<(f64, OrientedBox)>,
}

/// Moving objects of a drive, and lines on what was left out.
#[derive(Debug, Default)]
pub(super) struct MovingObjects {
    pub(super) tracks: Vec<Track>,
    pub(super) classes: Vec<(u32, ObjectClass)>,
    pub(super) notes: Vec<String>,
    /// Objects with seconds of two neighbouring labels, between which labels are missing.
    gaps: Vec<(u32, [f64; 2])>,
}

impl MovingObjects {
    /// Takes the objects that move. Their paths are extended by this many seconds at both ends, at the speed there.
    pub(super) fn of(objects: &[LabelledObject], extension_seconds: f64) -> Self {
        let mut found = Self::default();
        let (mut standing, mut tilt) = (Vec::new(), 0.0_f64);
        let steps: Vec<f64> = (objects.iter().flat_map(LabelledObject::steps))
            .map(|[before, after]| after - before)
            .collect();
        let longest = median(&steps).map_or(f64::INFINITY, |usual| GAP_STEPS * usual);
        for object in objects {
            let displacement = object.displacement();
            if displacement < LEAST_DISPLACEMENT_METRES {
                standing.push(object.id.to_string());
                continue;
            }
            let tilts = object.boxes.iter();
            let tilts = tilts.map(|(_, one)| one.axes.z_axis.angle_between(UP).to_degrees());
            tilt = tilts.fold(tilt, f64::max);
            let gaps = (object.steps()).filter(|[before, after]| after - before > longest);
            found.gaps.extend(gaps.map(|gap| (object.id, gap)));
            found.classes.push((object.id, object.class));
            found
                .tracks
                .push(object.track(displacement, extension_seconds));
        }
        let names = objects.iter().filter_map(|object| {
            let is_taken = found.classes.iter().any(|(id, _)| *id == object.id);
            let name = object.name.as_ref().filter(|_| is_taken)?;
            Some(format!("{} {name}", object.id))
        });
        let names: Vec<String> = names.collect();
        if !names.is_empty() {
            found.notes.push(format!(
                "moving objects and their names in the labels: {}",
                names.join(", ")
            ));
        }
        if !standing.is_empty() {
            found.notes.push(format!(
                "labelled objects that move by less than {LEAST_DISPLACEMENT_METRES} m, or are seen once: {} ({}); \
                 they belong to the static scene, and their boxes are left out",
                standing.len(),
                plain_text::first_of(&standing)
            ));
        }
        if tilt > REPORTED_TILT_DEGREES {
            found.notes.push(format!(
                "boxes are tilted by up to {tilt:.1} degrees from upright, which tracks do not hold: paths, boxes in images and \
                 the points that are left out are those of upright boxes"
            ));
        }
        found
    }

    /// Notes how many boxes of frames at these seconds lie in gaps of the labels; labels reach so far, seconds.
    pub(super) fn note_gaps(&mut self, frames: &[f64], reach_seconds: f64) {
        let is_bridged = |[before, after]: [f64; 2], seconds: f64| {
            seconds > before + reach_seconds && seconds < after - reach_seconds
        };
        let bridged = |gap: [f64; 2]| {
            frames
                .iter()
                .filter(move |&&at| is_bridged(gap, at))
                .count()
        };
        let boxes: usize = self.gaps.iter().map(|(_, gap)| bridged(*gap)).sum();
        let mut ids: Vec<u32> = self.gaps.iter().map(|(id, _)| *id).collect();
        ids.dedup();
        let ids: Vec<String> = ids.iter().map(u32::to_string).collect();
        if boxes > 0 {
            self.notes.push(format!(
                "labels of moving objects have gaps, over which their paths are straight: {} ({}); boxes without a \
                 label, interpolated in frames: {boxes}",
                ids.len(),
                plain_text::first_of(&ids)
            ));
        }
    }
}

impl LabelledObject {
    /// Returns the seconds of neighbouring labels.
    fn steps(&self) -> impl Iterator<Item = [f64; 2]> {
        let later = self.boxes.iter().skip(1);
        (self.boxes.iter().zip(later)).map(|((before, _), (after, _))| [*before, *after])
    }

    /// Returns the largest distance of the object from its first place.
    fn displacement(&self) -> f64 {
        let mut places = self.boxes.iter().map(|(_, one)| one.centre);
        let Some(first) = places.next() else {
            return 0.0;
        };
        places
            .map(|place| place.distance(first))
            .fold(0.0, f64::max)
    }

    /// Returns the path of the object, straight between its boxes, with the largest of their sides.
    fn track(&self, displacement: f64, extension_seconds: f64) -> Track {
        let axes = GroundAxes::new(UP);
        let times: Vec<f64> = self.boxes.iter().map(|(time, _)| *time).collect();
        let ends = [times.first(), times.last()];
        let [first, last] = ends.map(|time| time.copied().into_iter());
        let centre = BSpline {
            degree: 1,
            knots: first.chain(times.iter().copied()).chain(last).collect(),
            coefficients: (self.boxes.iter())
                .map(|(_, one)| one.centre.to_array())
                .collect(),
        };
        let sides = self.boxes.iter().map(|(_, one)| 2.0 * one.half);
        Track {
            id: self.id,
            class: self.class.name().to_owned(),
            dimensions: sides.fold(DVec3::ZERO, DVec3::max).to_array(),
            path: ObjectPath {
                centre: centre.extended(extension_seconds, extension_seconds),
                headings: (self.boxes.iter())
                    .map(|(_, one)| axes.heading(one.axes.x_axis))
                    .collect(),
                heading_seconds: times,
            },
            detections: u32::try_from(self.boxes.len()).unwrap_or(u32::MAX),
            displacement,
        }
    }
}

/// Returns the box of a track in the world at a time; `None` outside of its path.
pub(super) fn box_at(track: &Track, seconds: f64) -> Option<OrientedBox> {
    let (centre, heading) = track.path.at(seconds)?;
    Some(OrientedBox {
        centre,
        axes: GroundAxes::new(UP).rotation(heading),
        half: 0.5 * DVec3::from_array(track.dimensions),
    })
}

/// Returns true where a point of the world is in a box that is larger by `margin` on all sides.
pub(super) fn is_inside(one: &OrientedBox, margin: f64, point: DVec3) -> bool {
    let own = one.axes.transpose() * (point - one.centre);
    own.abs().cmple(one.half + margin).all()
}

/// Returns left, top, width and height of what an image shows of a box in the camera's frame, pixels; `None` where it
/// shows less than a pixel. Occlusion is ignored.
pub(super) fn projected(one: &OrientedBox, camera: &PinholeCamera) -> Option<[f64; 4]> {
    let corners = one.corners();
    let cut = |from: DVec3, to: DVec3| {
        if from.z >= NEAR_METRES {
            return from;
        }
        from + (to - from) * ((NEAR_METRES - from.z) / (to.z - from.z))
    };
    let (mut least, mut greatest) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for [from, to] in OrientedBox::EDGES {
        let (Some(&from), Some(&to)) = (corners.get(from), corners.get(to)) else {
            continue;
        };
        if from.z < NEAR_METRES && to.z < NEAR_METRES {
            continue;
        }
        for end in [cut(from, to), cut(to, from)] {
            let pixel = camera.project(end)?;
            (least, greatest) = (least.min(pixel), greatest.max(pixel));
        }
    }
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let (least, greatest) = (least.max(DVec2::ZERO), greatest.min(size));
    let sides = greatest - least;
    (sides.min_element() >= LEAST_SIDE_PIXELS).then_some([least.x, least.y, sides.x, sides.y])
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    fn object(id: u32, places: &[f64]) -> LabelledObject {
        let boxes = places.iter().enumerate().map(|(number, &x)| {
            let one = OrientedBox {
                centre: DVec3::new(x, 2.0, 0.5),
                axes: DMat3::from_rotation_z(0.25),
                half: DVec3::new(2.0, 1.0, 0.75),
            };
            (0.1 * number as f64, one)
        });
        LabelledObject {
            id,
            name: None,
            class: ObjectClass::Vehicle,
            boxes: boxes.collect(),
        }
    }

    #[test]
    fn what_moves_has_a_sound_path_through_its_boxes_and_what_stands_is_counted() {
        let objects = [
            object(4, &[0.0, 1.0, 3.0]),
            object(7, &[0.0, 0.3, -0.2]),
            object(9, &[5.0]),
        ];
        let moving = MovingObjects::of(&objects, 0.05);
        assert_eq!(moving.classes, [(4, ObjectClass::Vehicle)]);
        assert_eq!(moving.notes.len(), 1);
        assert!(moving.notes[0].contains(": 2 (7, 9)"), "{:?}", moving.notes);
        let [track] = &moving.tracks[..] else {
            panic!("one object moves");
        };
        assert_eq!(track.path.fault(), None);
        assert_eq!(track.dimensions, [4.0, 2.0, 1.5]);
        assert!((track.displacement - 3.0).abs() < 1e-12);
        // At 10 m/s, then 20 m/s; before and after at the speed of the ends.
        for (seconds, x) in [
            (-0.05, -0.5),
            (0.0, 0.0),
            (0.05, 0.5),
            (0.15, 2.0),
            (0.25, 4.0),
        ] {
            let found = box_at(track, seconds);
            assert!(
                found.is_some_and(|one| (one.centre.x - x).abs() < 1e-9
                    && one
                        .axes
                        .x_axis
                        .distance(DMat3::from_rotation_z(0.25).x_axis)
                        < 1e-9),
                "{seconds} s: {found:?}"
            );
        }
        assert_eq!(box_at(track, 0.26), None);
    }

    /// Labels at 0, 0.1, 0.2, 0.6 and 0.7 s: frames at 0.3, 0.4 and 0.5 s have none.
    #[test]
    fn boxes_in_gaps_of_labels_are_counted() {
        let mut gappy = object(4, &[0.0, 1.0, 2.0, 3.0, 4.0]);
        for (seconds, _) in gappy.boxes.iter_mut().skip(3) {
            *seconds += 0.3;
        }
        let frames: Vec<f64> = (0..8).map(|number| 0.1 * f64::from(number)).collect();
        let noted = |objects: &[LabelledObject], reach: f64| {
            let mut moving = MovingObjects::of(objects, reach);
            moving.note_gaps(&frames, reach);
            moving.notes
        };
        let whole = object(5, &[0.0, 1.0, 2.0, 3.0]);
        assert!(noted(std::slice::from_ref(&whole), 0.01).is_empty());
        let notes = noted(&[gappy.clone(), whole], 0.01);
        assert_eq!(notes.len(), 1, "{notes:?}");
        assert!(
            notes[0].contains(": 1 (4)") && notes[0].ends_with(": 3"),
            "{notes:?}"
        );
        // Labels that reach over a frame leave the one in the middle.
        let notes = noted(&[gappy], 0.15);
        assert!(notes[0].ends_with(": 1"), "{notes:?}");
    }

    #[test]
    fn a_box_is_projected_and_cut_at_the_camera_and_at_the_image() {
        let camera = PinholeCamera {
            width: 100,
            height: 80,
            fx: 50.0,
            fy: 50.0,
            cx: 50.0,
            cy: 40.0,
        };
        let cube = |x: f64, z: f64| OrientedBox {
            centre: DVec3::new(x, 0.0, z),
            axes: DMat3::IDENTITY,
            half: DVec3::ONE,
        };
        // Its near side is at 4, where a unit is 12.5 pixels.
        let found = projected(&cube(0.0, 5.0), &camera);
        let expected = [37.5, 27.5, 25.0, 25.0];
        assert!(found.is_some_and(|found| {
            let mut pairs = found.iter().zip(expected);
            pairs.all(|(found, expected)| (found - expected).abs() < 1e-9)
        }));
        assert_eq!(
            projected(&cube(0.0, 0.0), &camera),
            Some([0.0, 0.0, 100.0, 80.0])
        );
        assert_eq!(projected(&cube(0.0, -5.0), &camera), None);
        assert_eq!(projected(&cube(50.0, 5.0), &camera), None);
        assert!(is_inside(&cube(0.0, 5.0), 0.0, DVec3::new(0.9, -0.9, 5.9)));
        assert!(!is_inside(&cube(0.0, 5.0), 0.05, DVec3::new(1.1, 0.0, 5.0)));
        assert!(is_inside(&cube(0.0, 5.0), 0.2, DVec3::new(1.1, 0.0, 5.0)));
    }
}
