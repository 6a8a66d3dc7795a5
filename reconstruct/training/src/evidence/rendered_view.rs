//! A view and its render of the pilot fit: both at a point, and their difference.

use std::f32::consts::PI;

use glam::{Vec3, vec2};
use omnilife_schemas::{srgb, statistics::median};

use crate::{
    evidence::{
        flat_surfaces::{FLAT, Observation},
        poses::PoseObservation,
    },
    scene::TrainingScene,
};
use omnilife_engine::{
    camera::{Camera, CameraKernels, View, horizontal},
    gaussians::ActivatedGaussians,
    model::exposure::Exposure,
    render::cpu::Renderer,
    training_view::TrainingView,
};

/// A point is visible when it is no farther than this over the rendered depth,
const DEPTH_SLACK: f32 = 1.05;
/// where at least this much of the pixel is covered.
const LEAST_OPACITY: f32 = 0.5;
/// Minimum distance from the vertical axis, over that from the camera, of a point as evidence of a pose. Nearer
/// to it the neighbours in a row of pixels are nearly equal.
const LEAST_HORIZONTAL: f32 = 0.2;
/// Blocks side by side at the equator.
const BLOCKS_ACROSS: usize = 64;
/// Levels that no camera has clipped: means over pixels some of which are white are a little less than 1.
const KNOWN_LEVELS: [f32; 2] = [0.0, 0.98];
/// Maximum share of the values of a block outside of these: the light of others is unknown.
const LARGEST_CLIPPED_SHARE: f32 = 0.1;
/// Pixels for each one that the median level of an image is taken of.
const PIXELS_PER_SAMPLE: usize = 7;
/// Parts of an image.
pub(super) const SECTORS: usize = 8;

/// A view at a point: means over a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    pub(super) shown: [f32; 3],
    /// Image minus render.
    pub(super) residual: [f32; 3],
}

/// Means of linear light over a square of pixels without masks; each stands for the same part of the sphere, or of a
/// pinhole image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    /// Number of its part of the image, of [`SECTORS`]: quarters side by side, above and below the middle.
    pub(super) sector: usize,
    pub(super) shown: [f32; 3],
    pub(super) rendered: [f32; 3],
}

impl Patch {
    pub(super) fn rendered(&self) -> [f32; 3] {
        [0, 1, 2].map(|channel| self.shown[channel] - self.residual[channel])
    }
}

#[derive(Debug)]
pub(super) struct RenderedView {
    /// Its number among the input views.
    pub(super) number: usize,
    pub(super) width: usize,
    pub(super) height: usize,
    shown: Vec<[f32; 3]>,
    /// Image minus render; NaN in masked and ignored pixels.
    difference: Vec<[f32; 3]>,
    /// Radial depth; infinite where the render is thin, and in ignored regions.
    pub(super) depth: Vec<f32>,
}

impl RenderedView {
    pub(super) fn new(
        number: usize,
        view: &TrainingView,
        gaussians: &mut ActivatedGaussians,
        renderer: &mut Renderer,
    ) -> Self {
        let centre = view.view.centre;
        gaussians.feature_count = 1;
        gaussians.features = gaussians
            .positions
            .iter()
            .map(|&position| (Vec3::from_array(position) - centre).length())
            .collect();
        let raster = renderer.forward(&view.view, gaussians);
        let (mut image, mut mask) = (Vec::new(), Vec::new());
        view.write_image(&mut image);
        view.write_mask(&mut mask);
        let pixels = image
            .as_chunks::<3>()
            .0
            .iter()
            .zip(raster.colour.as_chunks::<3>().0);
        Self {
            number,
            shown: image.as_chunks::<3>().0.to_vec(),
            width: raster.width,
            height: raster.height,
            difference: pixels
                .zip(&mask)
                .enumerate()
                .map(|(pixel, ((truth, render), &masked))| {
                    let is_hidden = masked > 0.0 || !view.shows_scene(pixel);
                    let hole = if is_hidden { f32::NAN } else { 0.0 };
                    [0, 1, 2].map(|channel| truth[channel] - render[channel] + hole)
                })
                .collect(),
            depth: raster
                .features
                .iter()
                .zip(&raster.transmittance)
                .enumerate()
                .map(|(pixel, (depth, transmittance))| {
                    let opacity = 1.0 - transmittance;
                    if opacity > LEAST_OPACITY && view.shows_scene(pixel) {
                        depth / opacity
                    } else {
                        f32::INFINITY
                    }
                })
                .collect(),
        }
    }

    /// Returns the blocks of the whole image without masked pixels and without clipped ones but for a few: as many in a
    /// row as fit on the sphere. The view has its gain still.
    pub(super) fn blocks(&self, camera: &Camera) -> Vec<Block> {
        let side = (self.width / BLOCKS_ACROSS).max(1);
        let reach = side / 2;
        let columns = self.width / side;
        let light = self.light();
        let mut blocks = Vec::new();
        for row in (reach..self.height.saturating_sub(reach)).step_by(side) {
            let of_row = match camera {
                Camera::Erp(_) => {
                    let latitude = (0.5 - (row as f32 + 0.5) / self.height as f32) * PI;
                    (columns as f32 * latitude.cos()).round() as usize
                }
                Camera::Pinhole(_) => columns,
            };
            for number in 0..of_row {
                let column = (2 * number + 1) * self.width / (2 * of_row);
                let column = column.clamp(reach, self.width - 1 - reach);
                let quarter = 4 * column / self.width;
                let sector = 2 * quarter + usize::from(2 * row >= self.height);
                blocks.extend(self.block(sector, &light, [column, row], reach));
            }
        }
        blocks
    }

    /// Returns the linear light of image and render at every pixel; NaN for the render in masked and ignored ones.
    fn light(&self) -> Vec<[[f32; 3]; 2]> {
        let pixels = self.shown.iter().zip(&self.difference);
        let light = pixels.map(|(shown, difference)| {
            let rendered = [0, 1, 2].map(|channel| shown[channel] - difference[channel]);
            [shown.map(srgb::to_linear), rendered.map(srgb::to_linear)]
        });
        light.collect()
    }

    /// Returns the block of the pixels within `reach` of one, which is as far from all borders.
    fn block(
        &self,
        sector: usize,
        light: &[[[f32; 3]; 2]],
        [column, row]: [usize; 2],
        reach: usize,
    ) -> Option<Block> {
        let (mut shown, mut rendered, mut clipped) = ([0.0; 3], [0.0; 3], 0.0_f32);
        let [black, white] = KNOWN_LEVELS;
        for row in row - reach..=row + reach {
            for column in column - reach..=column + reach {
                let pixel = row * self.width + column;
                let [of_image, of_render] = light[pixel];
                for channel in 0..3 {
                    shown[channel] += of_image[channel];
                    rendered[channel] += of_render[channel];
                    let level = self.shown[pixel][channel];
                    if level <= black || level >= white {
                        clipped += 1.0;
                    }
                }
            }
        }
        let pixels = ((2 * reach + 1) * (2 * reach + 1)) as f32;
        let is_known = clipped <= LARGEST_CLIPPED_SHARE * 3.0 * pixels;
        let is_known = is_known && !rendered[0].is_nan();
        is_known.then(|| Block {
            sector,
            shown: shown.map(|sum| sum / pixels),
            rendered: rendered.map(|sum| sum / pixels),
        })
    }

    /// Returns the median level of some of the image's pixels, of all channels, 0 to 1.
    pub(super) fn median_level(&self) -> f32 {
        let some = self.shown.iter().step_by(PIXELS_PER_SAMPLE);
        let levels: Vec<f32> = some.flatten().copied().collect();
        median(&levels).unwrap_or_default()
    }

    /// Removes a gain from the image.
    pub(super) fn normalize(&mut self, exposure: &Exposure, seconds: f64) {
        for (shown, difference) in self.shown.iter_mut().zip(&mut self.difference) {
            let normalized = exposure.normalized(*shown, seconds);
            for channel in 0..3 {
                difference[channel] += normalized[channel] - shown[channel];
            }
            *shown = normalized;
        }
    }

    /// Returns the pixel of a point `offset` from the camera in its frame, at least `margin` pixels from the
    /// borders of the image. Where columns wrap, only the upper and lower border count. `None` where the point is
    /// hidden or not in the image.
    fn visible_pixel(
        &self,
        scene: &TrainingScene,
        offset: Vec3,
        margin: usize,
    ) -> Option<[usize; 2]> {
        let distance = offset.length();
        if distance <= 0.0 || self.height <= 2 * margin || self.width <= margin {
            return None;
        }
        let [mut column, row] = scene.camera.pixel_of(offset, distance)?;
        if !scene.camera.wraps() {
            if self.width <= 2 * margin {
                return None;
            }
            column = column.clamp(margin, self.width - 1 - margin);
        }
        let row = row.clamp(margin, self.height - 1 - margin);
        let is_visible = distance <= DEPTH_SLACK * self.depth[row * self.width + column];
        is_visible.then_some([column, row])
    }

    /// Returns the mean of the pixels within `reach` of one, which is as far from the borders that do not wrap;
    /// NaN if one of them is masked.
    fn mean(&self, [column, row]: [usize; 2], reach: usize) -> Patch {
        let (mut shown, mut residual) = ([0.0; 3], [0.0; 3]);
        for row in row - reach..=row + reach {
            for step in self.width - reach..=self.width + reach {
                let pixel = row * self.width + (column + step) % self.width;
                for channel in 0..3 {
                    shown[channel] += self.shown[pixel][channel];
                    residual[channel] += self.difference[pixel][channel];
                }
            }
        }
        let pixels = ((2 * reach + 1) * (2 * reach + 1)) as f32;
        Patch {
            shown: shown.map(|sum| sum / pixels),
            residual: residual.map(|sum| sum / pixels),
        }
    }

    /// Returns means of the pixels within `reach` of a point's image: a single pixel has the error of every edge
    /// on it. `None` where the point is hidden, or masked.
    pub(super) fn patch(
        &self,
        scene: &TrainingScene,
        view: &View,
        point: Vec3,
        reach: usize,
    ) -> Option<Patch> {
        let offset = view.rotation * (point - view.centre);
        let pixel = self.visible_pixel(scene, offset, reach)?;
        let patch = self.mean(pixel, reach);
        (!patch.residual[0].is_nan()).then_some(patch)
    }

    /// Returns true if the pixels around one have nearly one colour.
    pub(super) fn is_flat(&self, [column, row]: [usize; 2]) -> bool {
        let (mut least, mut largest) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for row in row - 1..=row + 1 {
            for step in self.width - 1..=self.width + 1 {
                let shown = self.shown[row * self.width + (column + step) % self.width];
                for channel in 0..3 {
                    least[channel] = least[channel].min(shown[channel]);
                    largest[channel] = largest[channel].max(shown[channel]);
                }
            }
        }
        (0..3).all(|channel| largest[channel] - least[channel] < FLAT)
    }

    /// Returns the colour of a surface where it is visible and looks flat.
    pub(super) fn flat_colour(
        &self,
        scene: &TrainingScene,
        view: &View,
        surface: Vec3,
    ) -> Option<Observation> {
        let offset = surface - view.centre;
        let pixel = self.visible_pixel(scene, view.rotation * offset, 1)?;
        let patch = self.mean(pixel, 1);
        (!patch.residual[0].is_nan() && self.is_flat(pixel)).then(|| Observation {
            view: self.number,
            direction: offset.normalize_or_zero(),
            colour: patch.shown,
        })
    }

    /// Returns a point's observation of the view's pose. `None` where it is hidden, masked, or near a pole.
    pub(super) fn pose_observation(
        &self,
        scene: &TrainingScene,
        view: &View,
        point: Vec3,
    ) -> Option<PoseObservation> {
        let offset = view.rotation * (point - view.centre);
        let distance = offset.length();
        let is_near_a_pole = match scene.camera {
            Camera::Erp(_) => horizontal(offset) < LEAST_HORIZONTAL * distance,
            Camera::Pinhole(_) => false,
        };
        if is_near_a_pole {
            return None;
        }
        let [column, row] = self.visible_pixel(scene, offset, 2)?;
        let rendered = |columns: usize, rows: usize| {
            let pixel = [
                (column + self.width + columns - 1) % self.width,
                row + rows - 1,
            ];
            self.mean(pixel, 1).rendered()
        };
        let [left, right, up, down] = [
            rendered(0, 1),
            rendered(2, 1),
            rendered(1, 0),
            rendered(1, 2),
        ];
        let residual = self.mean([column, row], 1).residual;
        let [by_column, by_row] = scene.camera.pixel_jacobian(offset);
        let to_world = view.rotation.transpose();
        // Derivative of each channel towards the image of the point after a motion in the world.
        let by_point = [0, 1, 2].map(|channel| {
            let slope = 0.5 * vec2(right[channel] - left[channel], down[channel] - up[channel]);
            to_world * (by_column * slope.x + by_row * slope.y)
        });
        let is_whole = residual[0].is_finite() && by_point.iter().all(|by| by.is_finite());
        is_whole.then(|| PoseObservation::new(point - view.centre, by_point, residual))
    }
}
