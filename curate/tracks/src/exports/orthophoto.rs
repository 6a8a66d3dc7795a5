//! `orthophoto`: the ground from straight above without moving vehicles, as PNG with a world file.
//!
//! Every pixel is a place on the ground plane of the scene. Its colour is the median, channel by channel, of up to nine
//! frames that show it outside of the boxes of moving vehicles, those with the smallest pixels on the ground. What
//! stands on the plane leans as in those frames. A place that no frame shows is transparent.
//!
//! The world file (`.pgw`) has the six terms of the affine map from columns and rows to coordinates, those of the
//! centre of the upper left pixel last: metres in UTM where the scene is georeferenced, else along the axes of the
//! ground.

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::{
    RgbImage, ground_plane::Plane, posed_view::PosedView, records::Georeference, rgb::Mask, rgba,
    scene_points::ScenePoints, statistics::median, trajectory::GroundAxes,
};
use rayon::prelude::*;
use serde_json::json;

use super::{Content, NamedFiles, TrackExport, TrackFormat};
use crate::{error::TracksError, georeference::geodesy, hover};

/// The format.
pub const FORMAT: TrackFormat = TrackFormat {
    id: "orthophoto",
    about: "the ground from above without moving vehicles: PNG, world file (.pgw) and JSON with the EPSG code",
    file: "orthophoto.png",
    content: Content::Files(write),
};

/// Name of the world file.
const WORLD_FILE: &str = "orthophoto.pgw";
/// Name of the description.
const DESCRIPTION_FILE: &str = "orthophoto.json";
/// Frames that are held in memory at most, evenly spread.
const MOST_FRAMES: usize = 60;
/// Frames whose median a pixel is.
const BEST: usize = 9;
/// Most pixels on a side; a larger ground gets larger pixels.
const MOST_PIXELS: f64 = 4096.0;
/// Least cosine between rays and the normal of the ground: 75 degrees.
const LEAST_COSINE: f64 = 0.26;
/// Margin around boxes of vehicles, pixels.
const MARGIN: f64 = 2.0;
/// Places across and down an image at which the extent of the ground is found.
const PLACES: u32 = 9;

fn write(export: &TrackExport<'_>) -> Result<NamedFiles, TracksError> {
    let refuse = |reason: &str| TracksError::input(export.scene_folder, reason);
    let views = PosedView::of_scene(export.scene, &export.tracks.frames);
    let ground = ground(export, &views)?;
    let map = GroundMap::of(export, ground);
    let step = views.len().div_ceil(MOST_FRAMES).max(1);
    let chosen: Vec<PosedView> = views.into_iter().step_by(step).collect();
    let raster = Raster::of(&chosen, &map).ok_or_else(|| {
        refuse("has no frame that shows the ground within 75 degrees of straight down")
    })?;
    let frames = chosen.iter().map(|view| OpenFrame::read(export, view));
    let frames: Vec<OpenFrame> = frames.collect::<Result<_, TracksError>>()?;
    let pixels: Vec<[u8; 4]> = (0..raster.height)
        .into_par_iter()
        .flat_map_iter(|row| {
            let (raster, map, frames) = (&raster, &map, &frames);
            (0..raster.width).map(move |column| {
                let place = map.on_ground(raster.place(column as f64, row as f64));
                colour(frames, map.ground, place)
            })
        })
        .collect();
    let unseen = pixels.iter().filter(|pixel| pixel[3] == 0).count();
    let size = (raster.width, raster.height);
    let png = rgba::straight_png(size, pixels.as_flattened());
    let png = png.map_err(|error| TracksError::internal(export.scene_folder, error))?;
    let description = json!({
        "scene": export.tracks.scene,
        "epsg": export.georeference.map(epsg),
        "axes": match export.georeference {
            Some(_) => "UTM, metres",
            None => "metres along the axes of the ground, not georeferenced",
        },
        "metres_per_pixel": raster.metres_per_pixel,
        "width": raster.width,
        "height": raster.height,
        "frames": frames.len(),
        "unseen_share": unseen as f64 / pixels.len() as f64,
        "content": "the ground plane without moving vehicles; what stands on it leans",
    });
    Ok(vec![
        (FORMAT.file, png),
        (WORLD_FILE, map.world_file(&raster).into_bytes()),
        (DESCRIPTION_FILE, format!("{description}\n").into_bytes()),
    ])
}

/// Returns the ground of most of a scene.
fn ground(export: &TrackExport<'_>, views: &[PosedView]) -> Result<Plane, TracksError> {
    let points = ScenePoints::find(export.scene, export.scene_folder, export.folder)?;
    let (points, _) = hover::static_points(points.as_ref(), export.scene, views)?;
    let centres: Vec<DVec3> = views.iter().map(|view| view.centre).collect();
    let found = Plane::dominant(&points, &centres);
    found.map(|(plane, _)| plane).ok_or_else(|| {
        TracksError::input(
            export.scene_folder,
            "has too few points to find the ground by",
        )
    })
}

/// Returns the EPSG code of the UTM zone on WGS 84.
fn epsg(georeference: &Georeference) -> u32 {
    let utm = &georeference.utm;
    let hemisphere = if utm.is_north { 32_600 } else { 32_700 };
    hemisphere + u32::from(utm.zone)
}

/// The ground, in metres along two axes: `metres = scale R x_world + offset`.
struct GroundMap<'a> {
    rotation: DMat3,
    scale: f64,
    offset: DVec3,
    ground: Plane,
    georeference: Option<&'a Georeference>,
}

impl<'a> GroundMap<'a> {
    fn of(export: &TrackExport<'a>, ground: Plane) -> Self {
        let georeference = export.georeference;
        let (rotation, scale, offset) = match georeference {
            Some(place) => {
                let [w, x, y, z] = place.rotation_wxyz;
                let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
                (
                    rotation,
                    place.metres_per_unit,
                    DVec3::from_array(place.offset),
                )
            }
            None => {
                let axes = GroundAxes::new(DVec3::from_array(export.tracks.up));
                let rotation = axes.to_world.transpose();
                (rotation, export.tracks.metres_per_unit, DVec3::ZERO)
            }
        };
        Self {
            rotation,
            scale,
            offset,
            ground,
            georeference,
        }
    }

    fn metres(&self, world: DVec3) -> DVec3 {
        self.scale * (self.rotation * world) + self.offset
    }

    /// Returns the world point on the ground at a place in metres.
    fn on_ground(&self, place: DVec2) -> DVec3 {
        let back = self.rotation.transpose();
        let world = back * ((place.extend(0.0) - self.offset) / self.scale);
        let up = back * DVec3::Z;
        world - self.ground.height(world) / self.ground.normal.dot(up) * up
    }

    /// Returns the coordinates of a place in metres: UTM, or these metres.
    fn coordinates(&self, place: DVec2) -> DVec2 {
        let Some(georeference) = self.georeference else {
            return place;
        };
        let up = self.metres(self.on_ground(place)).z;
        let point = geodesy::from_enu(&georeference.origin, dvec3(place.x, place.y, up));
        let utm = geodesy::utm_in(&point, georeference.utm.zone);
        dvec2(utm.easting, utm.northing)
    }

    /// Returns the text of the world file: change by a column of both coordinates, by a row, first pixel.
    fn world_file(&self, raster: &Raster) -> String {
        let [across, down] = [raster.width, raster.height].map(|side| side as f64 - 1.0);
        let first = self.coordinates(raster.place(0.0, 0.0));
        let by_column = (self.coordinates(raster.place(across, 0.0)) - first) / across;
        let by_row = (self.coordinates(raster.place(0.0, down)) - first) / down;
        let terms = [by_column, by_row, first].map(|term| term.to_array());
        let lines = terms.as_flattened().iter();
        lines.map(|term| format!("{term:.10}\n")).collect()
    }
}

/// Pixels over the ground, the first axis to the right, the second up.
struct Raster {
    width: usize,
    height: usize,
    /// Centre of the upper left pixel, metres.
    first: DVec2,
    metres_per_pixel: f64,
}

impl Raster {
    /// Returns the pixels over everything that some views show of the ground; `None` where they do not.
    fn of(views: &[PosedView], map: &GroundMap<'_>) -> Option<Self> {
        let mut sizes = Vec::new();
        let [mut least, mut most] = [DVec2::INFINITY, DVec2::NEG_INFINITY];
        for view in views {
            let size = DVec2::from_array(view.camera.size().map(|side| side as f64));
            for number in 0..PLACES * PLACES {
                let share = dvec2(f64::from(number % PLACES), f64::from(number / PLACES));
                let pixel = share / f64::from(PLACES - 1) * size;
                let ray = view.ray(pixel);
                let cosine = ray.dot(map.ground.normal).abs();
                let Some(distance) = map.ground.meet(view.centre, ray) else {
                    continue;
                };
                if cosine < LEAST_COSINE {
                    continue;
                }
                let place = map.metres(view.centre + distance * ray).truncate();
                (least, most) = (least.min(place), most.max(place));
                let [step, _] = view.ray_steps(pixel);
                sizes.push(step.length() * distance * map.scale);
            }
        }
        let extent = most - least;
        let metres_per_pixel = median(&sizes)?.max(extent.max_element() / (MOST_PIXELS - 1.0));
        let sides = (extent / metres_per_pixel).ceil().max(DVec2::ONE) + 1.0;
        let is_sound = metres_per_pixel > 0.0 && sides.is_finite();
        is_sound.then(|| Self {
            width: sides.x as usize,
            height: sides.y as usize,
            first: dvec2(least.x, most.y),
            metres_per_pixel,
        })
    }

    /// Returns the place of a column and a row, metres.
    fn place(&self, column: f64, row: f64) -> DVec2 {
        self.first + self.metres_per_pixel * dvec2(column, -row)
    }
}

/// A frame with the pixels that show no moving vehicle.
struct OpenFrame {
    view: PosedView,
    /// Interleaved RGB.
    pixels: Vec<u8>,
    /// Boxes of moving vehicles.
    boxes: Vec<[f64; 4]>,
    /// Ignored pixels, not 0.
    ignored: Option<Vec<u8>>,
}

impl OpenFrame {
    fn read(export: &TrackExport<'_>, view: &PosedView) -> Result<Self, TracksError> {
        let entry = export.scene.frames.get(view.frame as usize);
        let missing = || TracksError::input(export.scene_folder, "lacks a frame of its tracks");
        let entry = entry.ok_or_else(missing)?;
        let file = export.scene_folder.join(&entry.image);
        let image = RgbImage::read(&file)?;
        let [width, height] = view.camera.size();
        if [image.width, image.height] != [width, height] {
            let reason = format!(
                "must be {width}x{height}, got {}x{}",
                image.width, image.height
            );
            return Err(TracksError::input(&file, reason));
        }
        let ignored = entry.ignore_mask.as_ref().map(|mask| {
            let mask = Mask::read(&export.scene_folder.join(mask))?;
            Ok::<_, TracksError>(mask.resized_to_any(width, height).data)
        });
        let of_frame = export.tracks.detections.iter();
        let of_frame = of_frame.filter(|one| one.frame == view.frame && one.track.is_some());
        Ok(Self {
            view: *view,
            pixels: image.to_rgb8(),
            boxes: of_frame.map(|one| one.box_pixels).collect(),
            ignored: ignored.transpose()?,
        })
    }

    /// Returns the pixel that shows a place and the size of the place's surroundings in it; `None` where it is not
    /// seen.
    fn sight(&self, place: DVec3, ground: Plane) -> Option<(f64, DVec2)> {
        let pixel = self.view.pixel(place)?;
        let ray = place - self.view.centre;
        let distance = ray.length();
        let cosine = ray.dot(ground.normal).abs() / distance;
        let is_vehicle = self.boxes.iter().any(|&[left, top, width, height]| {
            (left - MARGIN..left + width + MARGIN).contains(&pixel.x)
                && (top - MARGIN..top + height + MARGIN).contains(&pixel.y)
        });
        let [columns, _] = self.view.camera.size();
        let at = pixel.y as usize * columns + pixel.x as usize;
        let ignored = self.ignored.as_ref();
        let is_ignored = ignored.is_some_and(|mask| mask.get(at).is_none_or(|mark| *mark != 0));
        let is_open = cosine >= LEAST_COSINE && !is_vehicle && !is_ignored;
        is_open.then_some((distance / cosine, pixel))
    }

    /// Returns the colour at a position in the image, interpolated.
    fn colour(&self, pixel: DVec2) -> [f64; 3] {
        let [columns, rows] = self.view.camera.size();
        let last = dvec2(columns as f64, rows as f64) - 1.0;
        let at = (pixel - 0.5).clamp(DVec2::ZERO, last);
        let floor = at.floor().min(last - 1.0).max(DVec2::ZERO);
        let part = at - floor;
        let mut sum = [0.0; 3];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let weight = (if dx == 1 { part.x } else { 1.0 - part.x })
                * (if dy == 1 { part.y } else { 1.0 - part.y });
            let column = (floor.x as usize + dx).min(columns - 1);
            let row = (floor.y as usize + dy).min(rows - 1);
            let first = 3 * (row * columns + column);
            for (sum, byte) in sum.iter_mut().zip(&self.pixels[first..first + 3]) {
                *sum += weight * f64::from(*byte);
            }
        }
        sum
    }
}

/// Returns the colour of a place on the ground, transparent where no frame shows it.
fn colour(frames: &[OpenFrame], ground: Plane, place: DVec3) -> [u8; 4] {
    let sights = frames
        .iter()
        .filter_map(|frame| Some((frame, frame.sight(place, ground)?)));
    let mut sights: Vec<(&OpenFrame, (f64, DVec2))> = sights.collect();
    if sights.is_empty() {
        return [0; 4];
    }
    sights.sort_by(|(_, (one, _)), (_, (other, _))| one.total_cmp(other));
    sights.truncate(BEST);
    let colours: Vec<[f64; 3]> = sights
        .iter()
        .map(|(frame, (_, pixel))| frame.colour(*pixel))
        .collect();
    let channel = |number: usize| {
        let values: Vec<f64> = colours.iter().map(|colour| colour[number]).collect();
        median(&values).unwrap_or(0.0).round() as u8
    };
    [channel(0), channel(1), channel(2), 255]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_on_the_ground_have_the_metres_that_they_are_of() {
        let up = dvec3(0.1, 0.2, 1.0).normalize();
        let map = GroundMap {
            rotation: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_z(1.1),
            scale: 2.5,
            offset: dvec3(30.0, -12.0, 4.0),
            ground: Plane {
                normal: up,
                offset: -0.7,
            },
            georeference: None,
        };
        for place in [dvec2(0.0, 0.0), dvec2(-5.0, 8.0)] {
            let world = map.on_ground(place);
            assert!(map.ground.height(world).abs() < 1e-9);
            assert!((map.metres(world).truncate() - place).length() < 1e-9);
        }
    }
}
