//! One camera for the images of a rig, which a scene has, and images resampled to it.
//!
//! Cameras of equal intrinsics keep their images. Others are resampled: images of two cameras in one place differ by
//! a scale and a shift alone, so this is exact but for interpolation. The common camera has square pixels, a centred
//! principal point and the shortest focal length at which every pixel of every camera is in the image.

use glam::{DVec2, DVec3, dvec2};
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, PinholeCamera},
    interpolation::Edges,
    rgb::Mask,
};

use super::objects;
use crate::poses::{frame_camera::FrameCamera, lens::Lens};

/// The camera of image files, with the lens that is removed from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OwnCamera {
    /// The camera without its lens; all that it shows is in the files.
    pub(crate) straight: PinholeCamera,
    lens: Option<Lens>,
}

impl From<PinholeCamera> for OwnCamera {
    fn from(straight: PinholeCamera) -> Self {
        Self {
            straight,
            lens: None,
        }
    }
}

impl OwnCamera {
    /// Returns the camera of files of `camera`, as `shown` has its lens.
    pub(super) fn of(camera: PinholeCamera, shown: &FrameCamera) -> Self {
        match shown {
            FrameCamera::Distorted { lens, straight } => Self {
                straight: *straight,
                lens: Some(*lens),
            },
            FrameCamera::Straight(_) | FrameCamera::Weak(_) => camera.into(),
        }
    }

    /// Returns width and height of the files, pixels.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.straight.width as usize, self.straight.height as usize]
    }

    /// Returns the place in a file, pixels, of a direction in the camera's frame; `None` where it is not shown.
    pub(super) fn place(&self, ray: DVec3) -> Option<DVec2> {
        let shown = self
            .straight
            .project(ray)
            .filter(|&pixel| holds(&self.straight, pixel))?;
        let Some(lens) = &self.lens else {
            return Some(shown);
        };
        Some(lens.source(&self.straight, shown)).filter(|&pixel| holds(&lens.camera, pixel))
    }
}

/// Returns the camera that shows every pixel of all cameras: their own where they are equal; `None` without cameras.
pub(super) fn common_camera(cameras: &[PinholeCamera]) -> Option<PinholeCamera> {
    let first = *cameras.first()?;
    if cameras.iter().all(|camera| *camera == first) {
        return Some(first);
    }
    let width = cameras.iter().map(|camera| camera.width).max()?;
    let height = cameras.iter().map(|camera| camera.height).max()?;
    let tangents = cameras.iter().map(|camera| {
        let [w, h] = [f64::from(camera.width), f64::from(camera.height)];
        let across = camera.cx.max(w - camera.cx) / camera.fx;
        let down = camera.cy.max(h - camera.cy) / camera.fy;
        [across, down]
    });
    let [across, down] = tangents.fold([0.0_f64; 2], |[x, y], [across, down]| {
        [x.max(across), y.max(down)]
    });
    let (w, h) = (f64::from(width), f64::from(height));
    let focal = (0.5 * w / across).min(0.5 * h / down);
    Some(PinholeCamera {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: 0.5 * w,
        cy: 0.5 * h,
    })
}

/// Returns true where a position is in an image of the camera.
pub(super) fn holds(camera: &PinholeCamera, pixel: DVec2) -> bool {
    let [width, height] = [f64::from(camera.width), f64::from(camera.height)];
    (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y)
}

/// Returns left, top, width and height of a box in an image of the camera `own` as `common`, at the same place, shows
/// it, pixels; `None` where that is less than a pixel.
pub(super) fn moved_box(
    [left, top, width, height]: [f64; 4],
    own: &PinholeCamera,
    common: &PinholeCamera,
) -> Option<[f64; 4]> {
    let [across, down] = [common.fx / own.fx, common.fy / own.fy];
    let moved = [
        across * (left - own.cx) + common.cx,
        down * (top - own.cy) + common.cy,
        across * width,
        down * height,
    ];
    let is_shown = moved[2].min(moved[3]) >= objects::LEAST_SIDE_PIXELS;
    is_shown.then_some(moved)
}

/// Returns an image of the camera `own` without its lens, as `common`, at the same place, shows it, and a mask of the pixels that it does
/// not show (255), which are black.
pub(crate) fn resampled(
    image: &RgbImage,
    own: &OwnCamera,
    common: &PinholeCamera,
) -> (RgbImage, Mask) {
    let [width, height] = [common.width as usize, common.height as usize];
    let mut shown = RgbImage::black(width, height);
    let mut outside = Mask {
        width,
        height,
        data: vec![0; width.saturating_mul(height)],
    };
    let (pixels, _) = shown.data.as_chunks_mut::<3>();
    let rows = pixels
        .chunks_mut(width.max(1))
        .zip(outside.data.chunks_mut(width.max(1)));
    for (row, (colours, marks)) in rows.enumerate() {
        for (column, (colour, mark)) in colours.iter_mut().zip(marks).enumerate() {
            let ray = common.unproject(dvec2(column as f64 + 0.5, row as f64 + 0.5));
            match own.place(ray) {
                Some(pixel) => *colour = image.sample(pixel, Edges::Repeated),
                None => *mark = 255,
            }
        }
    }
    (shown, outside)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec4, dvec3, vec4};
    use omnilife_schemas::oriented_box::OrientedBox;

    use super::*;

    const WIDE: PinholeCamera = PinholeCamera {
        width: 40,
        height: 20,
        fx: 20.0,
        fy: 20.0,
        cx: 20.0,
        cy: 10.0,
    };
    const NARROW: PinholeCamera = PinholeCamera {
        fx: 40.0,
        fy: 40.0,
        cx: 22.0,
        ..WIDE
    };

    #[test]
    fn equal_cameras_stay_and_others_get_one_that_shows_all_of_both() {
        assert_eq!(common_camera(&[]), None);
        assert_eq!(common_camera(&[NARROW, NARROW]), Some(NARROW));
        let common = common_camera(&[NARROW, WIDE]);
        assert_eq!(common, Some(WIDE));
        let shifted = PinholeCamera { cx: 15.0, ..WIDE };
        let common = common_camera(&[NARROW, shifted]).map(|camera| camera.fx);
        // The side of 25 pixels has to fit into a half of 20.
        assert!(common.is_some_and(|focal| (focal - 16.0).abs() < 1e-12));
    }

    /// An object beside the narrow image has no box in the wide one, though that would show it.
    #[test]
    fn boxes_end_where_their_image_ends() {
        let cube = |x: f64| OrientedBox {
            centre: dvec3(x, 0.0, 5.0),
            axes: DMat3::IDENTITY,
            half: DVec3::ONE,
        };
        let shown = |x: f64| {
            let of_image = objects::projected(&cube(x), &NARROW)?;
            moved_box(of_image, &NARROW, &WIDE)
        };
        let found = shown(0.0).map(|found| DVec4::from_array(found).as_vec4());
        // Its near side is at 4, where a unit is 5 pixels of the wide camera.
        assert_eq!(found, Some(vec4(15.0, 5.0, 10.0, 10.0)));
        // Cut at the right side of the image: (40 - 22) / 40 of the focal length.
        let found = shown(2.0).map(|[left, _, width, _]| left + width);
        assert!(found.is_some_and(|right| (right - 29.0).abs() < 1e-9));
        assert!(objects::projected(&cube(3.5), &WIDE).is_some());
        assert_eq!(shown(3.5), None);
    }

    /// A ramp over x keeps its values along the rays; what the narrow camera does not show is marked.
    #[test]
    fn resampled_pixels_keep_their_rays() {
        let mut image = RgbImage::black(40, 20);
        for (pixel, colour) in image.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            *colour = [((pixel % 40) as f32 + 0.5) / 40.0; 3];
        }
        let (shown, outside) = resampled(&image, &NARROW.into(), &WIDE);
        let (mut inside, mut marked) = (0, 0);
        for pixel in 0..800 {
            let (column, row) = (pixel % 40, pixel / 40);
            // x / z of the ray, by hand.
            let across = ((column as f64 + 0.5) - 20.0) / 20.0;
            let down = ((row as f64 + 0.5) - 10.0) / 20.0;
            let [u, v] = [40.0 * across + 22.0, 40.0 * down + 10.0];
            let is_inside = (0.0..40.0).contains(&u) && (0.0..20.0).contains(&v);
            assert_eq!(outside.data[pixel] == 0, is_inside, "pixel {pixel}");
            marked += usize::from(!is_inside);
            if is_inside && (0.5..39.5).contains(&u) {
                inside += 1;
                let found = f64::from(shown.data[3 * pixel]);
                assert!((found - u / 40.0).abs() < 1e-6, "pixel {pixel}: {found}");
            }
        }
        assert!(inside > 150 && marked > 500, "{inside}, {marked}");
    }
}
