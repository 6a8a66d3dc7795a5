//! `tracks.mp4`: every used frame, with its detections and tracks drawn over.

use std::path::Path;

use glam::{DVec2, DVec3, dvec2};
use omnilife_schemas::{
    RgbImage,
    camera::{Camera, CameraModel},
    oriented_box::OrientedBox,
    records::{Scene, Track, Tracks},
    statistics::frame_interval,
    trajectory::GroundAxes,
};
use opencv::{
    core::{Mat, MatTraitConst, MatTraitConstManual, Point, Scalar},
    imgproc,
};

use super::page::hue_degrees;
use crate::{
    error::CurateError,
    posed_view::PosedView,
    slicing::{Projection, ViewVideoWriter},
};

/// Maximum width of the video, pixels.
const WIDTH: usize = 1280;
/// Duration of a single frame, seconds.
const ONLY_FRAME_SECONDS: f64 = 1.0;
/// Length of the trail behind an object, seconds.
const TRAIL_SECONDS: f64 = 3.0;
/// Steps of that trail.
const TRAIL_STEPS: u32 = 24;
/// Fractional bits of drawn places: a sixteenth of a pixel.
const PLACE_BITS: i32 = 4;

/// Writes the video atomically. Thin boxes are as detected, in white if they belong to no object; boxes in space are as
/// tracked, with the number of the object and the trail behind it.
///
/// # Errors
/// When a frame cannot be read or the video cannot be written.
pub(super) fn write(
    path: &Path,
    folder: &Path,
    scene: &Scene,
    views: &[PosedView],
    tracks: &Tracks,
) -> Result<(), CurateError> {
    let times: Vec<f64> = views.iter().map(|view| view.seconds).collect();
    let (Some(&first), Some(&last)) = (times.first(), times.last()) else {
        return Ok(());
    };
    let [full_width, full_height] = scene.camera.size();
    let width = full_width.min(WIDTH);
    let height = (full_height * width / full_width).max(1);
    let projection = match scene.camera {
        Camera::Erp(_) => Projection::Equirectangular,
        Camera::Pinhole(_) => Projection::Flat,
    };
    let mut video = ViewVideoWriter::create(path, [width as u32, height as u32], projection)?;
    for view in views {
        let file = folder.join(&scene.frames[view.frame as usize].image);
        let image = RgbImage::read(&file)?.resized_by_area(width, height);
        let drawn = drawn(&image, view, tracks);
        let drawn = drawn.map_err(|error| CurateError::internal(&file, error))?;
        video.push(&drawn, view.seconds - first)?;
    }
    let of_frame = frame_interval(&times).unwrap_or(ONLY_FRAME_SECONDS);
    video.finish(last - first + of_frame)
}

/// Returns an image with everything drawn over it, 8-bit RGB.
fn drawn(image: &RgbImage, view: &PosedView, tracks: &Tracks) -> opencv::Result<Vec<u8>> {
    let bytes = image.to_rgb8();
    let pixels = Mat::from_slice(&bytes)?;
    let mut drawing = Drawing {
        pixels: pixels.reshape(3, image.height as i32)?.try_clone()?,
        view,
        scale: image.width as f64 / view.camera.size()[0] as f64,
    };
    let of_frame = tracks.detections.iter();
    for detection in of_frame.filter(|one| one.frame == view.frame) {
        let colour = detection.track.map_or([255.0; 3], colour);
        drawing.rectangle(detection.box_pixels, colour)?;
    }
    let axes = GroundAxes::new(DVec3::from_array(tracks.up));
    for track in &tracks.tracks {
        drawing.track(track, &axes)?;
    }
    let time = format!("{:.2} s", view.seconds);
    drawing.text(dvec2(6.0, 16.0) / drawing.scale, &time, [255.0; 3])?;
    Ok(drawing.pixels.data_bytes()?.to_vec())
}

/// Returns the colour of an object, as on the page.
fn colour(id: u32) -> [f64; 3] {
    const SATURATION: f64 = 0.85;
    const LIGHTNESS: f64 = 0.5;
    let reach = SATURATION * LIGHTNESS.min(1.0 - LIGHTNESS);
    [0.0, 8.0, 4.0].map(|offset| {
        let place = (offset + hue_degrees(id) / 30.0) % 12.0;
        255.0 * (LIGHTNESS - reach * (place - 3.0).min(9.0 - place).clamp(-1.0, 1.0))
    })
}

/// A frame that is drawn on.
struct Drawing<'a> {
    pixels: Mat,
    view: &'a PosedView,
    /// Its pixels in a pixel of the view.
    scale: f64,
}

impl Drawing<'_> {
    /// Draws a line between two places of the view, pixels; none across the seam of a panorama.
    fn line(
        &mut self,
        [from, to]: [DVec2; 2],
        colour: [f64; 3],
        thickness: i32,
    ) -> opencv::Result<()> {
        let [width, height] = self.view.camera.size().map(|side| side as f64);
        if self.view.camera.wraps() && (from.x - to.x).abs() > 0.5 * width {
            return Ok(());
        }
        // OpenCV's centre of the first pixel is at 0, and it counts in 32 bits.
        let far = dvec2(4.0 * width, 4.0 * height);
        let [from, to] = [from, to].map(|place| {
            let place = place.clamp(-far, far) * self.scale - 0.5;
            let place = place * f64::from(1 << PLACE_BITS);
            Point::new(place.x.round() as i32, place.y.round() as i32)
        });
        imgproc::line(
            &mut self.pixels,
            from,
            to,
            scalar(colour),
            thickness,
            imgproc::LINE_AA,
            PLACE_BITS,
        )
    }

    fn rectangle(
        &mut self,
        [left, top, width, height]: [f64; 4],
        colour: [f64; 3],
    ) -> opencv::Result<()> {
        let corners = [
            dvec2(left, top),
            dvec2(left + width, top),
            dvec2(left + width, top + height),
            dvec2(left, top + height),
        ];
        (0..4).try_for_each(|side| self.line([corners[side], corners[(side + 1) % 4]], colour, 1))
    }

    /// Draws text without a line break; `place` is its lower left corner.
    fn text(&mut self, place: DVec2, text: &str, colour: [f64; 3]) -> opencv::Result<()> {
        let place = place * self.scale;
        let place = Point::new(place.x.round() as i32, place.y.round() as i32);
        // A dark outline, readable over anything.
        for (colour, thickness) in [([0.0; 3], 3), (colour, 1)] {
            imgproc::put_text(
                &mut self.pixels,
                text,
                place,
                imgproc::FONT_HERSHEY_SIMPLEX,
                0.45,
                scalar(colour),
                thickness,
                imgproc::LINE_AA,
                false,
            )?;
        }
        Ok(())
    }

    /// Draws the box of an object in space, its number and its trail; nothing outside of its life.
    fn track(&mut self, track: &Track, axes: &GroundAxes) -> opencv::Result<()> {
        let now = self.view.seconds;
        let Some((centre, heading)) = track.path.at(now) else {
            return Ok(());
        };
        let (view, colour) = (self.view, colour(track.id));
        let image = |world: DVec3| view.camera.project(view.in_camera(world));
        let foot = axes.to_world.z_axis * (0.5 * track.dimensions[2]);
        let way = (0..=TRAIL_STEPS).map(|step| {
            let before = TRAIL_SECONDS * f64::from(step) / f64::from(TRAIL_STEPS);
            let (place, _) = track.path.at(now - before)?;
            image(place - foot)
        });
        let way: Vec<DVec2> = way.map_while(|place| place).collect();
        for pair in way.windows(2) {
            self.line([pair[0], pair[1]], colour, 1)?;
        }
        let rotation = axes.rotation(heading);
        let of_track = OrientedBox {
            centre,
            axes: rotation,
            half: 0.5 * DVec3::from_array(track.dimensions),
        };
        let corners: Option<Vec<DVec2>> = of_track.corners().map(image).into_iter().collect();
        let Some(corners) = corners else {
            return Ok(());
        };
        for from in 0..8_usize {
            for to in [1, 2, 4].map(|axis| from | axis) {
                if to != from {
                    self.line([corners[from], corners[to]], colour, 2)?;
                }
            }
        }
        // Its heading: from the middle of its roof to the middle of its front.
        let roof = centre + foot;
        let front = roof + rotation.x_axis * (0.5 * track.dimensions[0]);
        if let (Some(roof), Some(front)) = (image(roof), image(front)) {
            self.line([roof, front], colour, 2)?;
        }
        let top = corners.iter().fold(
            corners[0],
            |top, &corner| {
                if corner.y < top.y { corner } else { top }
            },
        );
        self.text(top - dvec2(0.0, 4.0), &track.id.to_string(), colour)
    }
}

fn scalar([red, green, blue]: [f64; 3]) -> Scalar {
    Scalar::new(red, green, blue, 0.0)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, dvec3};
    use omnilife_schemas::{
        camera::PinholeCamera,
        records::Detection,
        trajectory::{BSpline, ObjectPath},
    };

    use super::*;

    #[test]
    fn boxes_are_drawn_where_they_are_and_nothing_else_is() {
        let camera = PinholeCamera::with_horizontal_field_of_view(320, 180, 1.1);
        let view = PosedView {
            frame: 4,
            seconds: 2.0,
            camera: camera.into(),
            to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
            centre: dvec3(0.0, 0.0, 40.0),
        };
        let path = ObjectPath {
            centre: BSpline {
                degree: 1,
                knots: vec![0.0, 0.0, 4.0, 4.0],
                coefficients: vec![[-8.0, 0.0, 0.75], [8.0, 0.0, 0.75]],
            },
            heading_seconds: vec![0.0],
            headings: vec![0.0],
        };
        let detection = |box_pixels, track| Detection {
            frame: 4,
            box_pixels,
            confidence: 1.0,
            class: "vehicle".to_owned(),
            distance: None,
            position: None,
            track,
        };
        let tracks = Tracks {
            scene: "flight".to_owned(),
            frames: vec![4],
            image_size: [320, 180],
            up: [0.0, 0.0, 1.0],
            metres_per_unit: 1.0,
            stages: Vec::new(),
            detections: vec![detection([250.0, 120.0, 30.0, 20.0], None)],
            tracks: vec![Track {
                id: 2,
                class: "vehicle".to_owned(),
                dimensions: [4.5, 1.8, 1.5],
                path,
                detections: 5,
                displacement: 16.0,
            }],
            warnings: Vec::new(),
        };
        // Half the size of the view.
        let image = RgbImage::black(160, 90);
        let pixels = drawn(&image, &view, &tracks).expect("drawn");
        let brightness = |pixel: usize| -> u32 {
            let bytes = &pixels[3 * pixel..3 * pixel + 3];
            bytes.iter().map(|&byte| u32::from(byte)).sum()
        };
        let lit = |x: usize, y: usize| -> u32 {
            let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| y * 160 + x));
            around.map(brightness).max().unwrap_or(0)
        };
        // The middle of the picture is that of the roof, and the way behind comes from the left.
        assert!(lit(80, 45) > 200 && lit(62, 45) > 200);
        // The sides of the detection.
        assert!(lit(125, 65) > 300 && lit(132, 60) > 300);
        let elsewhere = [lit(110, 45), lit(30, 80), lit(140, 20), lit(132, 65)];
        assert_eq!(elsewhere, [0; 4]);
    }

    #[test]
    fn colours_of_neighbouring_objects_differ() {
        assert_eq!(colour(0).map(f64::round), [236.0, 19.0, 19.0]);
        let [a, b] = [1, 2].map(colour);
        let difference: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
        assert!(difference > 150.0, "{difference}");
    }
}
