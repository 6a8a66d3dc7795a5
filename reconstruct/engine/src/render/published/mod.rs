//! The renderer that ODGS publishes, with its defects, for comparison only.
//!
//! Source: ODGS `submodules/odgs-gaussian-rasterization/cuda_rasterizer/{forward,backward}.cu`, written from
//! its equations. Differences from [`crate::render`]:
//!
//! * **Pixels** are compared with projections at their corner `(i, j)`, not at `(i + 1/2, j + 1/2)`.
//! * **Footprints** are cut off at the seam, and stretch without bound towards the poles
//!   (`1 / (cos lat + 1e-7)`). Gaussians that are larger than their distance are drawn.
//! * **The gradient by the centre** goes through the projection scaled by half the image's size (normalized
//!   coordinates for densification), but is multiplied by the Jacobian in pixels. It is some hundred times too
//!   long, and twice as long along columns as along rows.
//! * **The gradients by scale and rotation** go through the unit tangent vectors without the scaling
//!   `S` from tangent to pixels.
//! * **One entry of the derivative of the Jacobian**, `dJ02/dz`, lacks its division by `rho^4`.
//! * Colours have SH degree 0.
//!
//! All differences are in `project`. Sorting, tiles and compositing are those of the other renderer, for a
//! camera whose columns do not wrap. One thing is not reproduced: a footprint ends where its opacity falls
//! below 1/255, at up to 3.33 standard deviations, not with the tiles touched by a square of 3.

mod project;

use omnilife_schemas::{
    RgbImage,
    camera::{ErpCamera, PinholeCamera},
};
use rayon::prelude::*;

use crate::{
    camera::{Camera, View, rays::Rays},
    gaussians::ActivatedGaussians,
    render::{
        Visible,
        bin::{TileLists, cpu::Binner, learning::LearningEntries},
        project::{Splat, SplatGradient, Splats, cpu::NOT_DRAWN},
        raster::{self, EntryGradients, Raster, RasterGradient},
        settings::RenderSettings,
        sort::{self, cpu::SortScratch},
    },
};

/// Renders ERP views as published; keeps the state for the backward pass, and its memory.
#[derive(Debug)]
pub struct PublishedRenderer {
    settings: RenderSettings,
    /// Tables of the camera drawn last, with columns that do not wrap.
    tables: Option<(ErpCamera, Rays, Binner)>,
    splats: Splats,
    distances: Vec<f32>,
    order: Vec<u32>,
    ranks: Vec<u32>,
    scratch: SortScratch,
    lists: TileLists,
    learning: LearningEntries,
    raster: Raster,
    entries: EntryGradients,
    visible: Vec<Visible>,
}

/// Returns the tables of a camera, the given ones if they are.
fn tables_of(
    camera: ErpCamera,
    tables: Option<(ErpCamera, Rays, Binner)>,
) -> (ErpCamera, Rays, Binner) {
    tables
        .filter(|tables| tables.0 == camera)
        .unwrap_or_else(|| {
            let rays = Rays::new(without_seam(camera));
            let binner = Binner::new(&rays);
            (camera, rays, binner)
        })
}

impl PublishedRenderer {
    /// Creates a renderer; memory is allocated by the first view. Footprint and degree of the settings are
    /// ignored.
    pub fn new(settings: RenderSettings) -> Self {
        Self {
            settings,
            tables: None,
            splats: Splats::default(),
            distances: Vec::new(),
            order: Vec::new(),
            ranks: Vec::new(),
            scratch: SortScratch::default(),
            lists: TileLists::default(),
            learning: LearningEntries::default(),
            raster: Raster::default(),
            entries: EntryGradients::default(),
            visible: Vec::new(),
        }
    }

    /// Renders one view.
    pub fn forward(&mut self, view: &View, gaussians: &ActivatedGaussians) -> &Raster {
        let camera = erp(view);
        let tables = tables_of(camera, self.tables.take());
        let (_, rays, binner) = self.tables.insert(tables);
        let projected = (0..gaussians.len()).into_par_iter().map(|index| {
            project::forward(view, camera, gaussians, &self.settings, index)
                .unwrap_or((Splat::default(), NOT_DRAWN))
        });
        projected.unzip_into_vecs(&mut self.splats.all, &mut self.distances);
        sort::cpu::by_distance(
            &self.distances,
            &mut self.order,
            &mut self.ranks,
            &mut self.scratch,
        );
        binner.forward(&self.splats, &self.order, &mut self.lists);
        let input = raster::cpu::Input {
            splats: &self.splats,
            gaussians,
            lists: &self.lists,
            rays,
            background: self.settings.background,
        };
        raster::cpu::forward(input, &mut self.raster);
        &self.raster
    }

    /// Computes the published gradients by the Gaussians of the view rendered last, from the gradient by its
    /// image (HWC). `out` is overwritten. The view is rendered first if none was rendered before.
    pub fn backward(
        &mut self,
        view: &View,
        gaussians: &ActivatedGaussians,
        image_gradient: &[f32],
        out: &mut ActivatedGaussians,
    ) {
        if self.tables.is_none() {
            self.forward(view, gaussians);
        }
        let tables = tables_of(erp(view), self.tables.take());
        let (camera, rays, _) = self.tables.insert(tables);
        let input = raster::cpu::Input {
            splats: &self.splats,
            gaussians,
            lists: &self.lists,
            rays,
            background: self.settings.background,
        };
        let upstream = RasterGradient::new(image_gradient, &[]);
        let all = 0..gaussians.len();
        self.learning.find(&self.lists, all.clone(), all);
        raster::cpu::backward(
            input,
            &self.learning,
            &self.raster,
            &upstream,
            &mut self.entries,
        );
        out.clear_to_zero(gaussians);
        self.visible.clear();
        let rows: Vec<project::RowGradient> = (0..gaussians.len())
            .into_par_iter()
            .filter(|&index| self.ranks[index] != u32::MAX)
            .map(|index| {
                let mut sum = SplatGradient::default();
                for &place in self.lists.places(self.ranks[index]) {
                    sum.accumulate(&self.entries.splats[place as usize]);
                }
                project::backward(
                    view,
                    *camera,
                    gaussians,
                    &self.splats.all[index],
                    &sum,
                    index,
                )
            })
            .collect();
        for row in rows {
            let index = row.visible.gaussian;
            self.visible.push(row.visible);
            out.positions[index] = row.position;
            out.scales[index] = row.scale;
            out.rotations[index] = row.rotation;
            out.opacities[index] = row.opacity;
            out.sh_constant[index] = row.sh_constant;
        }
    }

    /// Returns the visible Gaussians of the view rendered last, with the gradients of its last backward pass.
    pub fn visible(&self) -> impl Iterator<Item = Visible> {
        self.visible.iter().copied()
    }

    /// Renders one view as an image clamped to `[0, 1]`.
    pub fn image(&mut self, view: &View, gaussians: &ActivatedGaussians) -> RgbImage {
        self.forward(view, gaussians).image()
    }
}

/// Returns the ERP camera of a view. ODGS supports no other camera; its method and its runs refuse others.
fn erp(view: &View) -> ErpCamera {
    match view.camera {
        Camera::Erp(camera) => camera,
        Camera::Pinhole(_) => unreachable!("the published renderer draws ERP views"),
    }
}

/// Returns a camera of the same size whose columns do not wrap; ellipses use nothing else of it.
fn without_seam(camera: ErpCamera) -> Camera {
    PinholeCamera::with_horizontal_field_of_view(
        camera.width,
        camera.height,
        std::f64::consts::FRAC_PI_2,
    )
    .into()
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3, vec3};

    use super::*;
    use crate::gaussians::SH_C0;

    const CAMERA: ErpCamera = ErpCamera::new(64, 32);

    fn view() -> View {
        View {
            camera: CAMERA.into(),
            rotation: Mat3::IDENTITY,
            centre: Vec3::ZERO,
            time_seconds: 0.0,
        }
    }

    /// Returns one white Gaussian.
    fn one(position: Vec3, scales: [f32; 3]) -> ActivatedGaussians {
        let mut gaussians = ActivatedGaussians::default();
        gaussians.reshape(1, 0, 0);
        gaussians.positions[0] = position.to_array();
        gaussians.scales[0] = scales;
        gaussians.rotations[0] = [1.0, 0.0, 0.0, 0.0];
        gaussians.opacities[0] = 0.8;
        gaussians.sh_constant[0] = [0.5 / SH_C0; 3];
        gaussians
    }

    fn renderer() -> PublishedRenderer {
        PublishedRenderer::new(RenderSettings::new(0.2))
    }

    fn direction(column: f32, row: f32) -> Vec3 {
        let longitude = (column / 64.0 - 0.5) * std::f32::consts::TAU;
        let latitude = (0.5 - row / 32.0) * std::f32::consts::PI;
        vec3(
            latitude.cos() * longitude.sin(),
            -latitude.sin(),
            latitude.cos() * longitude.cos(),
        )
    }

    fn red(raster: &Raster, column: usize, row: usize) -> f32 {
        raster.colour[(row * raster.width + column) * 3]
    }

    #[test]
    fn pixels_are_compared_at_their_corners() {
        let gaussians = one(2.0 * direction(20.0, 12.0), [0.01; 3]);
        let mut renderer = renderer();
        let raster = renderer.forward(&view(), &gaussians);
        assert!((red(raster, 20, 12) - 0.8).abs() < 1e-4);
        assert!((red(raster, 19, 12) - red(raster, 21, 12)).abs() < 1e-4);
    }

    #[test]
    fn footprints_are_cut_at_the_seam() {
        let gaussians = one(2.0 * direction(63.4, 16.0), [0.3; 3]);
        let mut published = renderer();
        let raster = published.forward(&view(), &gaussians);
        assert!(red(raster, 63, 16) > 0.5 && red(raster, 0, 16) == 0.0);
        let mut exact = crate::render::cpu::Renderer::new(RenderSettings::new(0.2));
        assert!(red(exact.forward(&view(), &gaussians), 0, 16) > 0.5);
    }

    fn weights() -> Vec<f32> {
        let weight = |index: usize| {
            let (column, row) = ((index / 3) % 64, index / 3 / 64);
            (0.3 * column as f32 + 0.2 * row as f32).sin()
        };
        (0..64 * 32 * 3).map(weight).collect()
    }

    /// Returns a weighted sum of all pixels and its gradient by the Gaussians as published.
    fn loss(gaussians: &ActivatedGaussians) -> (f64, ActivatedGaussians) {
        let mut renderer = renderer();
        let raster = renderer.forward(&view(), gaussians);
        let weights = weights();
        let value = weights.iter().zip(&raster.colour);
        let value = value.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        let mut gradient = ActivatedGaussians::default();
        renderer.backward(&view(), gaussians, &weights, &mut gradient);
        (value, gradient)
    }

    fn difference(
        gaussians: &ActivatedGaussians,
        step: f32,
        change: impl Fn(&mut ActivatedGaussians, f32),
    ) -> f32 {
        let at = |step: f32| {
            let mut changed = gaussians.clone();
            change(&mut changed, step);
            loss(&changed).0
        };
        ((at(step) - at(-step)) / (2.0 * f64::from(step))) as f32
    }

    #[test]
    fn gradients_by_opacity_and_colour_are_right() {
        let gaussians = one(2.0 * direction(20.3, 12.6), [0.2, 0.1, 0.15]);
        let gradient = loss(&gaussians).1;
        let opacity = difference(&gaussians, 1e-2, |changed, step| {
            changed.opacities[0] += step;
        });
        let colour = difference(&gaussians, 1e-2, |changed, step| {
            changed.sh_constant[0][1] += step;
        });
        for (published, right) in [
            (gradient.opacities[0], opacity),
            (gradient.sh_constant[0][1], colour),
        ] {
            assert!(
                (published - right).abs() < 5e-3 * right.abs(),
                "{published} and {right}"
            );
        }
    }

    /// A backward pass without a forward pass before it renders the view itself.
    #[test]
    fn gradients_without_an_earlier_image_are_those_of_the_view() {
        let gaussians = one(2.0 * direction(20.3, 12.6), [0.1; 3]);
        let (_, behind_image) = loss(&gaussians);
        let mut alone = ActivatedGaussians::default();
        renderer().backward(&view(), &gaussians, &weights(), &mut alone);
        assert_eq!(alone, behind_image);
    }

    #[test]
    fn gradients_by_position_are_half_the_image_too_long() {
        // The low-pass filter dominates its small covariance: only the centre's image matters.
        let (distance, [column, row]) = (2.0, [20.3, 12.6]);
        let gaussians = one(distance * direction(column, row), [1e-4; 3]);
        let mut renderer = renderer();
        renderer.forward(&view(), &gaussians);
        let weights = weights();
        let mut gradient = ActivatedGaussians::default();
        renderer.backward(&view(), &gaussians, &weights, &mut gradient);
        let published = Vec3::from_array(gradient.positions[0]);
        // The other renderer gives the same image half a pixel further, at its pixels' centres.
        let shifted = one(distance * direction(column + 0.5, row + 0.5), [1e-4; 3]);
        let mut exact = crate::render::cpu::Renderer::new(RenderSettings::new(0.2));
        exact.forward(&view(), &shifted);
        let upstream = RasterGradient::new(&weights, &[]);
        exact.backward(&view(), &shifted, &upstream, &mut gradient);
        let by_pixel = exact.visible().map(|visible| visible.centre_gradient);
        let [by_u, by_v] = by_pixel.last().expect("it is visible");

        let n = direction(column, row);
        let east = vec3(n.z, 0.0, -n.x).normalize();
        let down = n.cross(east);
        let right = [
            by_u * 64.0 / (std::f32::consts::TAU * n.x.hypot(n.z) * distance),
            by_v * 32.0 / (std::f32::consts::PI * distance),
        ];
        for (tangent, right, half) in [(east, right[0], 32.0), (down, right[1], 16.0)] {
            let factor = published.dot(tangent) / right;
            assert!(
                (factor / half - 1.0).abs() < 2e-3,
                "{factor} times, not {half}"
            );
        }
    }

    #[test]
    fn gradients_by_scale_lack_the_pixels_per_unit() {
        let distance = 2.0;
        let gaussians = one(distance * direction(32.0, 16.0), [0.2, 0.3, 0.2]);
        let published = loss(&gaussians).1.scales[0];
        // At the image's centre the axes x and y are east and down.
        let stretch = [
            64.0 / std::f32::consts::TAU / distance,
            32.0 / std::f32::consts::PI / distance,
        ];
        for axis in 0..2 {
            let right = difference(&gaussians, 1e-2, |changed, step| {
                changed.scales[0][axis] += step;
            });
            let expected = right / (stretch[axis] * stretch[axis]);
            assert!(
                (published[axis] - expected).abs() < 0.02 * expected.abs(),
                "{} and {expected}",
                published[axis]
            );
        }
    }
}
