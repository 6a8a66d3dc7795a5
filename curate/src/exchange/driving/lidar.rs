//! Sweeps of a LiDAR: static points with colours, and distances in images.
//!
//! Points of static content are those outside the boxes of moving objects that an image of the same moment shows, one
//! in every cell of a grid. A LiDAR stands elsewhere than a camera and sees what is hidden from it: points behind the
//! boxes of moving objects are left out of an image, those behind static content are not. A sweep counts as taken at
//! one moment.

use std::{
    collections::{BTreeMap, HashSet},
    path::Path,
};

use glam::{DMat3, DVec2, DVec3};
use omnilife_schemas::{
    camera::{CameraModel, PinholeCamera},
    image_file::{ImageFile, ShownImage},
    oriented_box::OrientedBox,
    points::PointCloud,
    store::{self, StoreError},
};

use super::{
    objects,
    rig::{self, OwnCamera},
};

/// Side of the cells of which each keeps one point, metres.
const CELL_METRES: f64 = 0.1;
/// Margin by which boxes are larger: their labels are tight.
const BOX_MARGIN_METRES: f64 = 0.1;
/// Coordinate beyond which no point of a sweep can be, metres.
const FARTHEST_METRES: f64 = 1e5;
/// Size of a sweep of five million points of five floats.
const MOST_BYTES: u64 = 100_000_000;

/// Reads points as little-endian 32-bit floats, `values` of them for every point, of which the first three are
/// coordinates in the sensor's frame, metres.
///
/// # Errors
/// When the file is missing, truncated, or has coordinates that are not finite or beyond 100 km.
pub(super) fn read(path: &Path, values: usize) -> Result<Vec<DVec3>, StoreError> {
    let bytes = store::read_limited(path, MOST_BYTES)?;
    points_of(&bytes, values).map_err(|reason| StoreError::malformed(path, reason))
}

/// Reads the bytes of a file as [`read`] does.
fn points_of(bytes: &[u8], values: usize) -> Result<Vec<DVec3>, String> {
    let size = values.saturating_mul(4).max(4);
    if bytes.len().checked_rem(size) != Some(0) {
        return Err(format!(
            "must hold {values} floats, {size} bytes, for every point, got {} bytes in all",
            bytes.len()
        ));
    }
    let points = bytes.chunks_exact(size).enumerate().map(|(index, point)| {
        let (floats, _) = point.as_chunks::<4>();
        let mut floats = floats.iter().map(|bytes| f32::from_le_bytes(*bytes));
        let mut next = || floats.next().map_or(f64::NAN, f64::from);
        let place = DVec3::new(next(), next(), next());
        // NaN compares false, so it is refused too.
        let is_sound = place.abs().cmple(DVec3::splat(FARTHEST_METRES)).all();
        is_sound.then_some(place).ok_or_else(|| {
            let [x, y, z] = place.to_array();
            format!(
                "coordinates must be finite and within 100 km, got ({x}, {y}, {z}) of point {index}"
            )
        })
    });
    points.collect()
}

/// An image of the moment of a sweep.
pub(super) struct SweepView {
    image: ShownImage,
    own: OwnCamera,
    common: PinholeCamera,
    to_camera: DMat3,
    centre: DVec3,
    /// Boxes of moving objects at its own time, by the number of the object.
    boxes: Vec<Option<OrientedBox>>,
    /// Distances along the rays by the pixel's number in the image of the common camera, row by row; the nearest.
    pub(super) distances: BTreeMap<u32, f32>,
}

impl SweepView {
    /// Opens the image of a camera `own` that stands at `centre`, with this rotation to the world.
    ///
    /// # Errors
    /// When the image is damaged, or not of the camera's size.
    pub(super) fn open(
        image: &Path,
        (own, common): (OwnCamera, PinholeCamera),
        (to_world, centre): (DMat3, DVec3),
        boxes: Vec<Option<OrientedBox>>,
    ) -> Result<Self, StoreError> {
        let size = own.size();
        Ok(Self {
            image: ImageFile::open(image)?.expect_size(size)?.decode_shown()?,
            own,
            common,
            to_camera: to_world.transpose(),
            centre,
            boxes,
            distances: BTreeMap::new(),
        })
    }

    /// Enters a point of the world, and returns its colour; `None` where the image does not show it, because it is
    /// outside or behind a box of another object, at the time of the sweep or at that of the image.
    fn see(&mut self, point: DVec3, boxes: &[Option<OrientedBox>]) -> Option<[u8; 3]> {
        let to_point = point - self.centre;
        let hides = |one: &OrientedBox| {
            let crossing = one.crossing(self.centre, to_point);
            crossing.is_some_and(|[enter, _]| enter < 1.0)
        };
        let holds = |one: &OrientedBox| objects::is_inside(one, BOX_MARGIN_METRES, point);
        let hidden = boxes.iter().zip(&self.boxes).any(|(then, now)| {
            let both = [then, now].into_iter().flatten();
            !both.clone().any(holds) && both.into_iter().any(hides)
        });
        if hidden {
            return None;
        }
        let local = self.to_camera * to_point;
        let pixel = self.own.place(local)?;
        let shown = self.common.project(local)?;
        if !rig::holds(&self.common, shown) {
            return None;
        }
        let number = |width: u32, pixel: DVec2| {
            let [column, row] = pixel.to_array().map(|side| side as u32);
            row.saturating_mul(width).saturating_add(column)
        };
        let distance = local.length() as f32;
        let nearest = self
            .distances
            .entry(number(self.common.width, shown))
            .or_insert(distance);
        *nearest = nearest.min(distance);
        let (colours, _) = self.image.rgb.as_chunks::<3>();
        let place = number(self.own.straight.width, pixel) as usize;
        colours.get(place).copied()
    }
}

/// Static points of all sweeps.
#[derive(Debug, Default)]
pub(super) struct StaticPoints {
    cells: HashSet<[i64; 3]>,
    pub(super) cloud: PointCloud,
    /// Number of points in the boxes of moving objects.
    in_boxes: usize,
    /// Number of points that no image of their moment shows.
    unseen: usize,
    /// Number of points in cells that have one.
    thinned: usize,
}

impl StaticPoints {
    /// Adds the points of a sweep, in the world, and enters them into the images of its moment. `boxes` are those of
    /// moving objects.
    pub(super) fn add(
        &mut self,
        points: impl Iterator<Item = DVec3>,
        boxes: &[Option<OrientedBox>],
        views: &mut [SweepView],
    ) {
        for point in points {
            let seen = views.iter_mut().map(|view| view.see(point, boxes));
            // All views get its distance; the first has its colour.
            let colour = seen.fold(None, Option::or);
            let is_of_box = |one: &OrientedBox| objects::is_inside(one, BOX_MARGIN_METRES, point);
            let counter = match colour {
                _ if boxes.iter().flatten().any(is_of_box) => &mut self.in_boxes,
                None => &mut self.unseen,
                Some(colour) => {
                    let cell = (point / CELL_METRES).floor().to_array();
                    if self.cells.insert(cell.map(|side| side as i64)) {
                        self.cloud.positions.push(point.to_array());
                        self.cloud.colours.push(colour);
                        continue;
                    }
                    &mut self.thinned
                }
            };
            *counter = counter.saturating_add(1);
        }
    }

    /// Returns a line on the points that are kept and those that are left out; `None` without sweeps.
    pub(super) fn note(&self) -> Option<String> {
        let others = [self.in_boxes, self.unseen, self.thinned];
        (!self.cloud.is_empty() || others.iter().any(|&count| count > 0)).then(|| {
            format!(
                "LiDAR: {} static points; left out: {} in boxes of moving objects (the distances in the images have \
                 them), {} that no image of their moment shows, {} in cells of {CELL_METRES} m with another point",
                self.cloud.len(),
                self.in_boxes,
                self.unseen,
                self.thinned
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_read_and_cut_or_infinite_ones_refused() {
        let bytes = |values: &[f32]| -> Vec<u8> {
            values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect()
        };
        let good = bytes(&[1.0, -2.0, 0.5, 0.1, 4.0, 5.0, 6.0, 0.2]);
        let expected = vec![DVec3::new(1.0, -2.0, 0.5), DVec3::new(4.0, 5.0, 6.0)];
        assert_eq!(points_of(&good, 4), Ok(expected));
        assert!(points_of(&good, 5).is_err_and(|reason| reason.contains("32 bytes")));
        assert!(points_of(&good[..31], 4).is_err_and(|reason| reason.contains("31 bytes")));
        let bad = bytes(&[1.0, 2.0, 3.0, 0.0, 1.0, f32::NAN, 2.0, 0.0]);
        assert!(points_of(&bad, 4).is_err_and(|reason| reason.contains("point 1")));
        assert_eq!(points_of(&[], 4), Ok(Vec::new()));
    }

    /// Points in a box, in the cell of another, behind the camera and behind a box.
    #[test]
    fn points_in_boxes_and_unseen_ones_are_counted() {
        let mut points = StaticPoints::default();
        let moving = OrientedBox {
            centre: DVec3::X,
            axes: DMat3::IDENTITY,
            half: DVec3::splat(0.5),
        };
        let sweep = [DVec3::X, DVec3::new(9.0, 0.0, 0.0)];
        points.add(sweep.into_iter(), &[Some(moving)], &mut []);
        assert_eq!((points.in_boxes, points.unseen), (1, 1));
        let image = ShownImage {
            size: [2, 1],
            rgb: vec![10, 20, 30, 40, 50, 60],
            transparent: None,
            is_turned: false,
        };
        let camera = PinholeCamera {
            width: 2,
            height: 1,
            fx: 1.0,
            fy: 1.0,
            cx: 1.0,
            cy: 0.5,
        };
        let view = SweepView {
            image,
            own: camera.into(),
            common: camera,
            to_camera: DMat3::IDENTITY,
            centre: DVec3::ZERO,
            boxes: vec![None, None],
            distances: BTreeMap::new(),
        };
        let mut views = [view];
        let sweep = [
            DVec3::new(1.53, 0.0, 3.03),
            DVec3::new(1.55, 0.0, 3.05),
            DVec3::new(0.0, 0.0, -3.0),
            DVec3::new(-1.5, 0.0, 3.0),
        ];
        let before_last = OrientedBox {
            centre: DVec3::new(-1.0, 0.0, 2.0),
            ..moving
        };
        let boxes = [Some(moving), Some(before_last)];
        points.add(sweep.into_iter(), &boxes, &mut views);
        assert_eq!((points.unseen, points.thinned), (3, 1));
        assert_eq!(points.cloud.colours, [[40, 50, 60]]);
        let nearest = DVec3::new(1.53, 0.0, 3.03).length() as f32;
        assert_eq!(views[0].distances, BTreeMap::from([(1, nearest)]));
        assert!(
            points
                .note()
                .is_some_and(|note| note.contains("1 static points"))
        );
    }

    /// At the time of the image a car is before the wall, at that of the sweep it is elsewhere. Its own points stay.
    #[test]
    fn points_behind_a_box_at_the_time_of_the_image_are_left_out() {
        let camera = PinholeCamera {
            width: 2,
            height: 1,
            fx: 1.0,
            fy: 1.0,
            cx: 1.0,
            cy: 0.5,
        };
        let car = |x: f64| OrientedBox {
            centre: DVec3::new(x, 0.0, 5.0),
            axes: DMat3::IDENTITY,
            half: DVec3::splat(0.5),
        };
        let mut view = SweepView {
            image: ShownImage {
                size: [2, 1],
                rgb: vec![0; 6],
                transparent: None,
                is_turned: false,
            },
            own: camera.into(),
            common: camera,
            to_camera: DMat3::IDENTITY,
            centre: DVec3::ZERO,
            boxes: vec![Some(car(1.0))],
            distances: BTreeMap::new(),
        };
        let wall = DVec3::new(2.0, 0.0, 10.0);
        assert!(view.see(wall, &[Some(car(4.0))]).is_none());
        assert!(
            view.see(DVec3::new(2.0, 3.0, 10.0), &[Some(car(4.0))])
                .is_some()
        );
        // The side of the car at the time of the sweep, which it hides half a metre later.
        assert!(
            view.see(DVec3::new(1.2, 0.0, 5.5), &[Some(car(1.2))])
                .is_some()
        );
    }
}
