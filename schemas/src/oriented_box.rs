//! Boxes with any position and heading, as cameras see them.

use glam::{DMat3, DVec3, dvec2, dvec3};

use crate::{
    camera::{Camera, CameraModel},
    mask::Mask,
};

/// Side in pixels of the parts of an image that are skipped as a whole.
const PART: usize = 16;
/// Factor by which a part of an image may be wider than its corners: its sides are curves on the sphere.
const PART_MARGIN: f64 = 1.1;

/// Box of the points within `half` of its centre along its own axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    /// Centre of the box.
    pub centre: DVec3,
    /// Axes of the box, as columns.
    pub axes: DMat3,
    /// Halves of its sides.
    pub half: DVec3,
}

impl OrientedBox {
    /// Pairs of corners that an edge joins, by the numbers of [`OrientedBox::corners`].
    pub const EDGES: [[usize; 2]; 12] = [
        [0, 1],
        [2, 3],
        [4, 5],
        [6, 7],
        [0, 2],
        [1, 3],
        [4, 6],
        [5, 7],
        [0, 4],
        [1, 5],
        [2, 6],
        [3, 7],
    ];

    /// Returns its corners: bit `n` of a corner's number is set on the far side along axis `n`.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|number| {
            let side = |axis: usize| if number >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let own = dvec3(side(0), side(1), side(2)) * self.half;
            self.centre + self.axes * own
        })
    }

    /// Returns the interval of a ray inside of the box, in lengths of `direction`, which need not be 1; `None` where
    /// the ray misses it or leaves it behind. A ray that begins in it enters at 0.
    pub fn crossing(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let to_own = self.axes.transpose();
        let origin = to_own * (origin - self.centre);
        let direction = to_own * direction;
        let (mut from, mut to) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let sides = [-self.half[axis], self.half[axis]];
            if direction[axis] == 0.0 {
                if origin[axis].abs() > self.half[axis] {
                    return None;
                }
                continue;
            }
            let [a, b] = sides.map(|side| (side - origin[axis]) / direction[axis]);
            from = from.max(a.min(b));
            to = to.min(a.max(b));
        }
        (from < to).then_some([from, to])
    }

    /// Returns the box in the frame of a camera with this rotation from the camera to the world.
    #[must_use]
    pub fn in_camera(&self, to_world: DMat3, camera_centre: DVec3) -> Self {
        let to_camera = to_world.transpose();
        Self {
            centre: to_camera * (self.centre - camera_centre),
            axes: to_camera * self.axes,
            half: self.half,
        }
    }

    /// Marks the pixels of an image whose rays meet the box, which is in the camera's frame; `mask` has the camera's
    /// size. Occlusion is ignored.
    pub fn mark(&self, camera: &Camera, mask: &mut Mask) {
        let [width, height] = camera.size();
        let ray = |x: f64, y: f64| camera.unproject(dvec2(x, y));
        let (distance, reach) = (self.centre.length(), self.half.length());
        let middle = self.centre.normalize_or_zero();
        // With the camera within its reach, the box may be in any direction.
        let radius = if distance > reach {
            (reach / distance).asin()
        } else {
            std::f64::consts::PI
        };
        for top in (0..height).step_by(PART) {
            let bottom = (top + PART).min(height);
            for left in (0..width).step_by(PART) {
                let right = (left + PART).min(width);
                let [x0, x1, y0, y1] = [left, right, top, bottom].map(|side| side as f64);
                let centre = ray(0.5 * (x0 + x1), 0.5 * (y0 + y1));
                let corners = [ray(x0, y0), ray(x1, y0), ray(x0, y1), ray(x1, y1)];
                let part = corners.map(|corner| centre.angle_between(corner));
                let part = PART_MARGIN * part.into_iter().fold(0.0, f64::max);
                if centre.angle_between(middle) > radius + part {
                    continue;
                }
                for y in top..bottom {
                    for x in left..right {
                        let direction = ray(x as f64 + 0.5, y as f64 + 0.5);
                        if self.crossing(DVec3::ZERO, direction).is_some() {
                            mask.data[y * width + x] = 255;
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{ErpCamera, PinholeCamera};

    fn empty(camera: &Camera) -> Mask {
        let [width, height] = camera.size();
        Mask::new(width, height, vec![0; width * height])
    }

    fn boxes() -> Vec<OrientedBox> {
        let places = [
            dvec3(0.0, 0.0, 9.0),
            // Over the seam of a panorama, at its pole, around the camera, beside it.
            dvec3(0.1, 0.3, -6.0),
            dvec3(0.2, -4.0, 0.1),
            dvec3(0.3, 0.1, 0.2),
            dvec3(-3.0, 1.0, 5.0),
        ];
        let place = |(number, centre): (usize, DVec3)| OrientedBox {
            centre,
            axes: DMat3::from_rotation_y(0.7 * number as f64) * DMat3::from_rotation_x(0.3),
            half: dvec3(2.2, 0.9, 0.7),
        };
        places.into_iter().enumerate().map(place).collect()
    }

    /// Skipped parts of an image would have had no marked pixel.
    #[test]
    fn what_is_marked_are_the_pixels_whose_rays_meet_the_box() {
        let cameras: [Camera; 2] = [
            PinholeCamera::with_horizontal_field_of_view(150, 70, 1.4).into(),
            ErpCamera::new(200, 100).into(),
        ];
        for camera in cameras {
            for (number, one) in boxes().into_iter().enumerate() {
                let mut mask = empty(&camera);
                one.mark(&camera, &mut mask);
                let [width, _] = camera.size();
                let mut marked = 0;
                for (pixel, &value) in mask.data.iter().enumerate() {
                    let centre = dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                    let meets = one
                        .crossing(DVec3::ZERO, camera.unproject(centre))
                        .is_some();
                    assert_eq!(value != 0, meets, "box {number}, pixel {centre}");
                    marked += usize::from(meets);
                }
                let behind = !camera.wraps() && [1, 2].contains(&number);
                assert_eq!(marked == 0, behind, "box {number}");
            }
        }
    }

    #[test]
    fn a_ray_crosses_where_geometry_says() {
        let one = OrientedBox {
            centre: dvec3(5.0, 0.0, 0.0),
            axes: DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2),
            half: dvec3(3.0, 1.0, 1.0),
        };
        // Its short side is along x.
        assert_eq!(one.crossing(DVec3::ZERO, DVec3::X), Some([4.0, 6.0]));
        assert_eq!(one.crossing(DVec3::ZERO, 2.0 * DVec3::X), Some([2.0, 3.0]));
        assert_eq!(
            one.crossing(dvec3(5.0, 0.0, 0.0), DVec3::X),
            Some([0.0, 1.0])
        );
        assert_eq!(one.crossing(DVec3::ZERO, DVec3::NEG_X), None);
        assert_eq!(one.crossing(DVec3::ZERO, DVec3::Y), None);
        assert_eq!(one.crossing(dvec3(0.0, 0.0, 1.5), DVec3::X), None);
    }
}
