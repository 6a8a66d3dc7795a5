//! Conversion of frames with other sphere layouts to equirectangular ones.
//!
//! For stereo the left eye's image is cut out. Cube faces, fisheye circles and halves of the sphere are sampled on the
//! sphere (`sampler`), each pixel by as many rays as it covers stored pixels. `places` maps directions to their place
//! in the frame, `lens_estimate` estimates the lenses of a dual fisheye camera. A test compares with the same layouts
//! of `FFmpeg`'s filter `v360`.

mod lens_estimate;
mod places;
mod sampler;

use omnilife_schemas::{
    RgbImage,
    records::{DetectedProjection, FaceOrder, FisheyeCircle, Probe, SphereLayout, VideoProjection},
    rgb::Mask,
};
use omnilife_video::Rgb8Image;

use crate::projection;

pub(crate) use lens_estimate::estimated_dual_fisheye;

use sampler::SphereSampler;

/// Two lenses with the least possible field of view: no others have a wider sphere in as many pixels.
pub(crate) const NARROWEST_DUAL_FISHEYE: SphereLayout = SphereLayout::DualFisheye {
    field_of_view_degrees: 180.0,
    circles: [FisheyeCircle::WHOLE; 2],
};

/// Returns the limits of width over height for frames of a layout. Players and cameras store some squeezed, two eyes at
/// half their width or cube faces at 16:9.
fn aspects(layout: SphereLayout) -> [f64; 2] {
    match layout {
        SphereLayout::StereoTopBottom => [0.9, 2.2],
        SphereLayout::StereoLeftRight => [1.7, 4.4],
        SphereLayout::HalfErp => [0.8, 1.25],
        SphereLayout::HalfErpLeftRight => [1.6, 2.5],
        SphereLayout::HalfErpTopBottom => [0.4, 0.65],
        SphereLayout::EquiangularCubemap | SphereLayout::Cubemap { columns: 3, .. } => [1.4, 1.85],
        SphereLayout::Cubemap { columns: 1, .. } => [0.14, 0.2],
        SphereLayout::Cubemap { .. } => [5.0, 7.0],
        SphereLayout::DualFisheye { .. } => [1.7, 2.2],
    }
}

/// Refuses frames of an aspect ratio that a layout never has.
///
/// # Errors
/// One line with both aspect ratios.
pub(crate) fn expect_shape(
    layout: SphereLayout,
    (width, height): (u32, u32),
) -> Result<(), String> {
    let [narrowest, widest] = aspects(layout);
    let aspect = f64::from(width) / f64::from(height);
    if (narrowest..=widest).contains(&aspect) {
        return Ok(());
    }
    Err(format!(
        "frames of {layout} must be {narrowest} to {widest} times as wide as high, got {width}x{height}"
    ))
}

/// Converter of the frames of one video to equirectangular images.
#[derive(Debug)]
pub(crate) struct ToErp {
    layout: SphereLayout,
    sampler: Option<SphereSampler>,
}

impl ToErp {
    /// Creates a converter for frames of a layout.
    pub(crate) fn new(layout: SphereLayout) -> Self {
        Self {
            layout,
            sampler: None,
        }
    }

    /// Returns the equirectangular image of a frame, upright as shown, `width` pixels wide and half as high.
    pub(crate) fn convert(&mut self, frame: &Rgb8Image, width: usize) -> Rgb8Image {
        let size = [width, width / 2];
        if let Some(eye) = left_eye(self.layout, frame) {
            return resized(eye, size);
        }
        let stored = [frame.width, frame.height];
        let sampler = match self.sampler.take() {
            Some(sampler) if sampler.is_for(stored, size) => sampler,
            _ => SphereSampler::new(self.layout, stored, size),
        };
        let image = sampler.apply(frame);
        self.sampler = Some(sampler);
        image
    }
}

/// Returns an equirectangular image at another size, by area averaging.
fn resized(image: Rgb8Image, [width, height]: [usize; 2]) -> Rgb8Image {
    if [image.width, image.height] == [width, height] {
        return image;
    }
    let data = RgbImage::from_rgb8(image.width, image.height, &image.data)
        .resized_by_area(width, height)
        .to_rgb8();
    Rgb8Image::new(width, height, data)
}

/// Returns the left eye's half of a stereo frame; `None` for other layouts.
fn left_eye(layout: SphereLayout, frame: &Rgb8Image) -> Option<Rgb8Image> {
    let (width, height) = match layout {
        SphereLayout::StereoTopBottom => (frame.width, frame.height / 2),
        SphereLayout::StereoLeftRight => (frame.width / 2, frame.height),
        _ => return None,
    };
    let rows = frame.data.chunks_exact(3 * frame.width).take(height);
    Some(Rgb8Image::new(
        width,
        height,
        rows.flat_map(|row| &row[..3 * width]).copied().collect(),
    ))
}

/// Returns true for a layout that stores only the front half of the sphere.
pub(crate) fn is_half(layout: SphereLayout) -> bool {
    projection(layout) == VideoProjection::HalfErp
}

/// Marks the pixels of equirectangular images of `size` that frames of `stored` pixels do not fully cover; `None` if
/// the layout stores the whole sphere.
pub(crate) fn unrecorded(
    layout: SphereLayout,
    (columns, rows): (u32, u32),
    size: [usize; 2],
) -> Option<Mask> {
    is_half(layout).then(|| {
        let stored = [columns as usize, rows as usize];
        SphereSampler::new(layout, stored, size).unrecorded()
    })
}

/// Returns the width in pixels that frames need so that their equirectangular image of `width` pixels is not upsampled.
pub(crate) fn stored_width(layout: SphereLayout, width: u32, stored: (u32, u32)) -> u32 {
    let native = layout.erp_width(stored).max(1);
    let share = f64::from(width) / f64::from(native);
    (f64::from(stored.0) * share).ceil() as u32
}

pub(crate) fn projection(layout: SphereLayout) -> VideoProjection {
    match layout {
        SphereLayout::StereoTopBottom => VideoProjection::ErpStereoTb,
        SphereLayout::StereoLeftRight => VideoProjection::ErpStereoLr,
        SphereLayout::HalfErp | SphereLayout::HalfErpLeftRight | SphereLayout::HalfErpTopBottom => {
            VideoProjection::HalfErp
        }
        SphereLayout::EquiangularCubemap | SphereLayout::Cubemap { .. } => VideoProjection::Eac,
        SphereLayout::DualFisheye { .. } => VideoProjection::Fisheye,
    }
}

/// Returns the layout if the evidence leaves no doubt: stereo, and faces of a cube and halves of the sphere if stated by
/// the container. No image shows the order of faces or the field of view of a lens.
pub(crate) fn evident(found: &DetectedProjection, probe: &Probe) -> Option<SphereLayout> {
    // If halves are alike and their borders dark, seams and poles of a half look like those of a whole. A single image
    // that closes around and has caps is not stereo.
    if let Some(half) = stated_half(probe).filter(|_| found.projection != VideoProjection::Erp) {
        return Some(half);
    }
    match found.projection {
        VideoProjection::ErpStereoTb => Some(SphereLayout::StereoTopBottom),
        VideoProjection::ErpStereoLr => Some(SphereLayout::StereoLeftRight),
        VideoProjection::Eac => stated(probe),
        _ => None,
    }
}

/// Returns the layout that the container alone states, before any frame is decoded.
pub(crate) fn stated(probe: &Probe) -> Option<SphereLayout> {
    let spherical = probe.spherical.as_ref()?;
    let is_single = matches!(spherical.stereo.as_deref(), None | Some("2D"));
    let faces = match spherical.projection.as_str() {
        "equiangular cubemap" => Some(SphereLayout::EquiangularCubemap),
        // Version 1 has no layout of faces.
        "cubemap" if is_single && spherical.origin != "v1" => Some(SphereLayout::Cubemap {
            columns: 3,
            faces: FaceOrder::STANDARD,
        }),
        _ => None,
    };
    faces
        .filter(|_| !spherical.is_cropped)
        .or_else(|| stated_half(probe))
}

/// Returns the layout in the words of the metadata, if these state another one than a monoscopic equirectangular image of
/// the whole sphere.
pub(crate) fn stated_other(probe: &Probe) -> Option<String> {
    if let Some(layout) = stated(probe) {
        return Some(layout.to_string());
    }
    let (stated, words) = projection::by_metadata(probe)?;
    (!stated.is_monoscopic_erp()).then_some(words)
}

fn stated_half(probe: &Probe) -> Option<SphereLayout> {
    let spherical = probe.spherical.as_ref()?;
    if spherical.projection != "equirectangular" || !spherical.is_front_half {
        return None;
    }
    match spherical.stereo.as_deref() {
        None | Some("2D") => Some(SphereLayout::HalfErp),
        Some("side by side") => Some(SphereLayout::HalfErpLeftRight),
        Some("top and bottom") => Some(SphereLayout::HalfErpTopBottom),
        Some(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, dvec2};
    use omnilife_schemas::camera::{CameraModel, ErpCamera};

    use super::*;

    const WIDTH: usize = 240;

    fn colour(direction: DVec3) -> [u8; 3] {
        let level = 0.5 + 0.4 * direction;
        level.to_array().map(|level| (255.0 * level).round() as u8)
    }

    fn erp(width: usize) -> Rgb8Image {
        let camera = ErpCamera::new(width as u32, width as u32 / 2);
        let pixels = (0..width * width / 2).map(|at| {
            let centre = dvec2((at % width) as f64, (at / width) as f64) + 0.5;
            colour(camera.unproject(centre))
        });
        Rgb8Image::new(width, width / 2, pixels.flatten().collect())
    }

    /// Returns an image of two lenses back to back.
    fn fisheye(degrees: f64, [width, height]: [usize; 2]) -> Rgb8Image {
        let half = width / 2;
        let pixels = (0..width * height).map(|at| {
            let (x, y) = (at % width, at / width);
            let side = if x < half { -1.0 } else { 1.0 };
            let within = dvec2((x % half) as f64, y as f64) + 0.5;
            let from_middle = within / dvec2(half as f64, height as f64) * 2.0 - 1.0;
            let angle = from_middle.length() * 0.5 * degrees.to_radians();
            let across = from_middle.normalize() * angle.sin();
            colour(DVec3::new(side * across.x, across.y, side * angle.cos()))
        });
        Rgb8Image::new(width, height, pixels.flatten().collect())
    }

    /// Gives every pixel of cube faces the colour of the direction whose place is nearest to its centre, found by a
    /// walk over many directions.
    fn stored(layout: SphereLayout, [width, height]: [usize; 2]) -> Rgb8Image {
        let camera = ErpCamera::new(1600, 800);
        let mut nearest = vec![(f64::INFINITY, [0; 3]); width * height];
        for pixel in 0..1600 * 800 {
            let centre = dvec2(f64::from(pixel % 1600), f64::from(pixel / 1600)) + 0.5;
            let direction = camera.unproject(centre);
            let Some(place) = places::place(layout, [width, height], direction) else {
                continue;
            };
            let cell = place.at.floor();
            let (x, y) = (cell.x as usize, cell.y as usize);
            if x < width && y < height {
                let distance = place.at.distance(cell + 0.5);
                let entry = &mut nearest[y * width + x];
                if distance < entry.0 {
                    *entry = (distance, colour(direction));
                }
            }
        }
        Rgb8Image::new(
            width,
            height,
            nearest.iter().flat_map(|&(_, colour)| colour).collect(),
        )
    }

    #[test]
    fn every_direction_is_shown_where_it_is() -> Result<(), String> {
        let cases = [
            ("eac", [192, 128]),
            ("cubemap-3x2", [192, 128]),
            ("cubemap-6x1:frblud", [384, 64]),
            ("cubemap-1x6", [64, 384]),
            ("dual-fisheye:190", [240, 120]),
            ("dual-fisheye:220", [240, 120]),
        ];
        let truth = erp(WIDTH);
        for (name, size) in cases {
            let layout: SphereLayout = name.parse()?;
            let frame = match layout {
                SphereLayout::DualFisheye {
                    field_of_view_degrees,
                    ..
                } => fisheye(field_of_view_degrees, size),
                _ => stored(layout, size),
            };
            let found = ToErp::new(layout).convert(&frame, WIDTH);
            assert_eq!([found.width, found.height], [WIDTH, WIDTH / 2]);
            let errors = found.data.iter().zip(&truth.data);
            let worst = errors.map(|(a, b)| a.abs_diff(*b)).max();
            // A pixel and a half at the edges of faces.
            assert!(worst.is_some_and(|worst| worst <= 5), "{name}: {worst:?}");
        }
        Ok(())
    }

    #[test]
    fn of_stereo_the_left_eye_is_taken() {
        let left = erp(WIDTH);
        let mut above = left.clone();
        above.height *= 2;
        above.data.extend(vec![9; left.data.len()]);
        let found = ToErp::new(SphereLayout::StereoTopBottom).convert(&above, WIDTH);
        assert_eq!(found, left);
        let rows = left.data.chunks_exact(3 * WIDTH);
        let beside = Rgb8Image {
            width: 2 * WIDTH,
            height: left.height,
            data: rows
                .flat_map(|row| [row, &[9; 3 * WIDTH]].concat())
                .collect(),
        };
        let found = ToErp::new(SphereLayout::StereoLeftRight).convert(&beside, WIDTH);
        assert_eq!(found, left);
    }

    #[test]
    fn of_half_a_sphere_the_rest_is_black_and_marked() {
        let whole = erp(WIDTH);
        let (half, height) = (WIDTH / 2, WIDTH / 2);
        let rows = whole.data.chunks_exact(3 * WIDTH);
        let ahead: Vec<u8> = rows
            .flat_map(|row| &row[3 * WIDTH / 4..9 * WIDTH / 4])
            .copied()
            .collect();
        let other_eye = [9; 3 * WIDTH / 2];
        let beside = ahead.chunks_exact(3 * half);
        let beside: Vec<u8> = beside.flat_map(|row| [row, &other_eye].concat()).collect();
        let above = [ahead.as_slice(), &other_eye.repeat(height)].concat();
        let is_ahead = |pixel: usize| (WIDTH / 4..WIDTH * 3 / 4).contains(&(pixel % WIDTH));
        for (layout, width, data) in [
            (SphereLayout::HalfErp, half, ahead),
            (SphereLayout::HalfErpLeftRight, WIDTH, beside),
            (SphereLayout::HalfErpTopBottom, half, above),
        ] {
            let height = data.len() / (3 * width);
            let frame = Rgb8Image::new(width, height, data);
            let found = ToErp::new(layout).convert(&frame, WIDTH);
            for (at, (found, whole)) in found.data.iter().zip(&whole.data).enumerate() {
                let expected = if is_ahead(at / 3) { *whole } else { 0 };
                assert!(
                    found.abs_diff(expected) <= 1,
                    "{layout} {at}: {found} {expected}"
                );
            }
            let stored = (width as u32, height as u32);
            let marked = unrecorded(layout, stored, [WIDTH, WIDTH / 2]).map(|mask| mask.data);
            let expected = (0..WIDTH * WIDTH / 2).map(|pixel| 255 * u8::from(!is_ahead(pixel)));
            assert_eq!(marked, Some(expected.collect()), "{layout}");
            assert_eq!(layout.erp_width(stored), WIDTH as u32);
        }
        assert_eq!(
            unrecorded(SphereLayout::EquiangularCubemap, (192, 128), [64, 32]),
            None
        );
    }

    #[test]
    fn widths_have_the_same_pixels_around_the_horizon() -> Result<(), String> {
        for (name, stored, expected) in [
            ("stereo-top-bottom", (3840, 3840), 3840),
            ("stereo-left-right", (7680, 1920), 3840),
            ("eac", (2880, 1920), 3840),
            ("cubemap-6x1", (6144, 1024), 4096),
            ("dual-fisheye:180", (3840, 1920), 3840),
            ("half-erp", (2880, 2880), 5760),
            ("half-erp-left-right", (5760, 2880), 5760),
            ("half-erp-top-bottom", (2880, 5760), 5760),
        ] {
            let layout: SphereLayout = name.parse()?;
            assert_eq!(layout.erp_width(stored), expected, "{name}");
            assert_eq!(
                stored_width(layout, expected / 4, stored),
                stored.0 / 4,
                "{name}"
            );
        }
        Ok(())
    }
}
