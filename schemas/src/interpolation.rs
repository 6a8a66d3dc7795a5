//! Values of an image between the centres of its pixels.

use glam::{DVec2, DVec3, dvec2};

use crate::{
    camera::{
        CameraModel, ErpCamera,
        cube::{CUBE_FACES, face_camera},
    },
    rgb::RgbImage,
};

/// Values beyond the left and the right edge of an image. Beyond the upper and the lower edge the outermost row
/// repeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edges {
    /// Values of the other edge, as in an equirectangular image.
    Around,
    /// Values of the outermost column.
    Repeated,
}

/// Returns the four pixels around a position in an image of `[width, height]` (neither is zero) with their bilinear
/// weights, which add up to 1. `place` is finite and in pixels from the image's corner: the centre of the first pixel
/// is at (1/2, 1/2).
pub fn bilinear([width, height]: [usize; 2], edges: Edges, place: DVec2) -> [(usize, f64); 4] {
    let from_centre = place - 0.5;
    let first = from_centre.floor();
    let share = from_centre - first;
    let column = |offset: f64| match edges {
        Edges::Around => (first.x + offset).rem_euclid(width as f64) as usize % width,
        Edges::Repeated => (first.x + offset).clamp(0.0, (width - 1) as f64) as usize,
    };
    let row = |offset: f64| (first.y + offset).clamp(0.0, (height - 1) as f64) as usize;
    [
        (0.0, 0.0, (1.0 - share.x) * (1.0 - share.y)),
        (1.0, 0.0, share.x * (1.0 - share.y)),
        (0.0, 1.0, (1.0 - share.x) * share.y),
        (1.0, 1.0, share.x * share.y),
    ]
    .map(|(dx, dy, weight)| (row(dy) * width + column(dx), weight))
}

impl RgbImage {
    /// Returns the bilinear colour at a position; see [`bilinear`].
    pub fn sample(&self, place: DVec2, edges: Edges) -> [f32; 3] {
        let mut colour = [0.0; 3];
        for (pixel, weight) in bilinear([self.width, self.height], edges, place) {
            let values = &self.data[3 * pixel..3 * pixel + 3];
            for (sum, value) in colour.iter_mut().zip(values) {
                *sum += weight as f32 * value;
            }
        }
        colour
    }
}

/// Puts a panorama together from square faces in the order of [`CUBE_FACES`]. Every pixel is sampled from the face that
/// its direction meets, bilinear within the face; without faces it is black.
pub fn panorama_of_faces(faces: &[RgbImage], camera: ErpCamera) -> RgbImage {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut panorama = RgbImage::black(width, height);
    for (pixel, out) in panorama.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let centre = dvec2((pixel % width) as f64, (pixel / width) as f64) + 0.5;
        let direction = camera.unproject(centre);
        // The face whose axis is nearest to the direction.
        let ahead = |index: &usize| direction.dot(CUBE_FACES[*index].to_camera * DVec3::Z);
        let known = 0..faces.len().min(CUBE_FACES.len());
        let Some(index) = known.max_by(|a, b| ahead(a).total_cmp(&ahead(b))) else {
            continue;
        };
        let face = &faces[index];
        let within = CUBE_FACES[index].to_camera.transpose() * direction;
        if let Some(place) = face_camera(face.width as u32).project(within) {
            *out = face.sample(place, Edges::Repeated);
        }
    }
    panorama
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> RgbImage {
        RgbImage::new(4, 2, (0..8).flat_map(|pixel| [pixel as f32; 3]).collect())
    }

    #[test]
    fn centres_have_their_pixels_colour_and_places_between_have_both() {
        let image = ramp();
        for edges in [Edges::Around, Edges::Repeated] {
            assert_eq!(image.sample(dvec2(2.5, 1.5), edges), [6.0; 3]);
            assert_eq!(image.sample(dvec2(2.0, 0.5), edges), [1.5; 3]);
            assert_eq!(image.sample(dvec2(0.75, 1.0), edges), [2.25; 3]);
        }
    }

    #[test]
    fn a_panorama_goes_on_around_its_seam_and_other_images_end() {
        let image = ramp();
        for place in [dvec2(0.0, 0.5), dvec2(4.0, 0.5), dvec2(-4.0, 0.5)] {
            assert_eq!(image.sample(place, Edges::Around), [1.5; 3], "{place}");
        }
        assert_eq!(image.sample(dvec2(0.0, 0.5), Edges::Repeated), [0.0; 3]);
        assert_eq!(image.sample(dvec2(4.0, 0.5), Edges::Repeated), [3.0; 3]);
    }

    #[test]
    fn rows_beyond_a_pole_repeat_the_last() {
        let image = ramp();
        assert_eq!(image.sample(dvec2(1.5, -3.0), Edges::Around), [1.0; 3]);
        assert_eq!(image.sample(dvec2(1.5, 9.0), Edges::Around), [5.0; 3]);
    }

    #[test]
    fn a_panorama_of_faces_shows_every_direction_where_it_is() {
        let side = 96;
        let camera = ErpCamera::new(120, 60);
        let colour = |direction: DVec3| 0.5 * (direction + 1.0);
        let faces = CUBE_FACES.map(|face| {
            let mut image = RgbImage::black(side, side);
            for (pixel, out) in image.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let centre = dvec2((pixel % side) as f64, (pixel / side) as f64) + 0.5;
                let direction = face_camera(side as u32).unproject(centre);
                *out = colour(face.to_camera * direction).as_vec3().to_array();
            }
            image
        });
        let panorama = panorama_of_faces(&faces, camera);
        for (pixel, found) in panorama.data.as_chunks::<3>().0.iter().enumerate() {
            let centre = dvec2((pixel % 120) as f64, (pixel / 120) as f64) + 0.5;
            let error =
                DVec3::from_array(found.map(f64::from)).distance(colour(camera.unproject(centre)));
            // The outermost half pixel of a face repeats its edge.
            assert!(error < 0.01, "{pixel}: {error}");
        }
    }
}
