//! Places of directions in a frame.

use std::f64::consts::{FRAC_1_PI, FRAC_2_PI, PI};

use glam::{DVec2, DVec3, dvec2};
use omnilife_schemas::{
    camera::cube::CUBE_FACES,
    records::{FisheyeCircle, SphereLayout},
};

/// Pixels around each row of faces of an equi-angular cubemap that repeat their neighbours (`libavfilter/vf_v360.c`,
/// `pixel_pad`).
const EQUIANGULAR_PADDING: f64 = 2.0;

/// A place in a frame, pixels from its corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub(super) at: DVec2,
    /// First and last corner of the continuous part of the frame around the place.
    pub(super) part: [DVec2; 2],
}

/// Returns the place of a direction (x right, y down, z forward, not zero) in a frame of `[width, height]` pixels.
/// `None` if the layout does not store it, or is one of whole equirectangular images.
pub(super) fn place(
    layout: SphereLayout,
    [width, height]: [usize; 2],
    direction: DVec3,
) -> Option<Place> {
    let size = dvec2(width as f64, height as f64);
    match layout {
        SphereLayout::StereoTopBottom | SphereLayout::StereoLeftRight => None,
        SphereLayout::HalfErp => in_half(size, direction),
        SphereLayout::HalfErpLeftRight => in_half(size * dvec2(0.5, 1.0), direction),
        SphereLayout::HalfErpTopBottom => in_half(size * dvec2(1.0, 0.5), direction),
        SphereLayout::EquiangularCubemap => Some(in_equiangular(size, direction)),
        SphereLayout::Cubemap { columns, faces } => {
            let (face, on_face) = on_cube(direction);
            let grid = dvec2(f64::from(columns), f64::from(6 / columns.max(1)));
            let position = faces.position(face) as f64;
            let cell = dvec2(position % grid.x, (position / grid.x).floor());
            Some(in_cell(cell, on_face, size / grid, DVec2::ZERO))
        }
        SphereLayout::DualFisheye {
            field_of_view_degrees,
            circles,
        } => {
            let lens = usize::from(direction.z >= 0.0);
            let lens = Lens {
                is_front: lens == 1,
                field_of_view: field_of_view_degrees.to_radians(),
                circle: circles[lens],
            };
            lens.place(size, direction)
        }
    }
}

/// Returns the place of a direction in an equirectangular image of the front half of the sphere, in the upper left
/// corner of a frame; `None` behind.
fn in_half(size: DVec2, direction: DVec3) -> Option<Place> {
    let across = direction.x.atan2(direction.z) * FRAC_1_PI;
    let down = (direction.y / direction.length()).asin() * FRAC_1_PI;
    (direction.z >= 0.0).then(|| Place {
        at: (dvec2(across, down) + 0.5) * size,
        part: [DVec2::ZERO, size],
    })
}

/// Returns the number of the face of [`CUBE_FACES`] that a direction meets, and its place there, right and down from
/// the middle, both in [-1, 1].
fn on_cube(direction: DVec3) -> (usize, DVec2) {
    let ahead = |face: &usize| direction.dot(CUBE_FACES[*face].to_camera.z_axis);
    let nearest = (0..CUBE_FACES.len()).max_by(|a, b| ahead(a).total_cmp(&ahead(b)));
    let face = nearest.unwrap_or_default();
    let within = CUBE_FACES[face].to_camera.transpose() * direction;
    (face, dvec2(within.x, within.y) / within.z)
}

/// Returns a place on the face in a cell of the grid of faces; `margin` is around every row of them.
fn in_cell(cell: DVec2, on_face: DVec2, face_size: DVec2, margin: DVec2) -> Place {
    let corner = cell * face_size + margin;
    Place {
        at: corner + 0.5 * (on_face + 1.0) * face_size,
        part: [corner, corner + face_size],
    }
}

/// The cell of each face of [`CUBE_FACES`] in an equi-angular cubemap, and the directions on the face of the frame's
/// columns and rows.
const EQUIANGULAR_CELLS: [([f64; 2], DVec2, DVec2); 6] = [
    ([1.0, 0.0], DVec2::X, DVec2::Y),
    ([2.0, 0.0], DVec2::X, DVec2::Y),
    ([1.0, 1.0], DVec2::NEG_Y, DVec2::X),
    ([0.0, 0.0], DVec2::X, DVec2::Y),
    ([2.0, 1.0], DVec2::Y, DVec2::NEG_X),
    ([0.0, 1.0], DVec2::Y, DVec2::NEG_X),
];

fn in_equiangular(size: DVec2, direction: DVec3) -> Place {
    let (face, on_face) = on_cube(direction);
    let (cell, columns, rows) = EQUIANGULAR_CELLS[face];
    // Pixels have equal angles instead of equal lengths on the face.
    let angles = dvec2(on_face.x.atan(), on_face.y.atan()) * 2.0 * FRAC_2_PI;
    let turned = dvec2(angles.dot(columns), angles.dot(rows));
    let inner = size - 2.0 * EQUIANGULAR_PADDING * dvec2(1.0, 2.0);
    let margin = EQUIANGULAR_PADDING * dvec2(1.0, 1.0 + 2.0 * cell[1]);
    in_cell(
        DVec2::from_array(cell),
        turned,
        inner / dvec2(3.0, 2.0),
        margin,
    )
}

/// One of two lenses back to back.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    /// True if it looks ahead; its circle is on the right.
    pub(super) is_front: bool,
    /// Field of view of its circle from edge to edge, radians.
    pub(super) field_of_view: f64,
    pub(super) circle: FisheyeCircle,
}

impl Lens {
    /// Returns the place of a direction in a frame of `size` pixels; `None` outside the lens's field of view.
    pub(super) fn place(&self, size: DVec2, direction: DVec3) -> Option<Place> {
        // For the lens at the back, right is the camera's left.
        let (ahead, right, first) = if self.is_front {
            (direction.z, direction.x, 0.5 * size.x)
        } else {
            (-direction.z, -direction.x, 0.0)
        };
        let across = dvec2(right, direction.y);
        let from_axis = across.length().atan2(ahead);
        let radius = from_axis / (0.5 * self.field_of_view);
        let towards = across.try_normalize().unwrap_or(DVec2::ZERO);
        let half = dvec2(0.5 * size.x, size.y);
        debug_assert!(from_axis <= PI);
        let centre = DVec2::from_array(self.circle.centre);
        (radius <= 1.0).then(|| Place {
            at: dvec2(first, 0.0) + half * (centre + self.circle.radius * radius * towards),
            part: [dvec2(first, 0.0), dvec2(first, 0.0) + half],
        })
    }
}
