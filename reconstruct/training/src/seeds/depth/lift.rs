//! Lift of a view's pixels to flat Gaussians on their surfaces.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3, dvec2};
use omnilife_engine::{
    camera::{Camera, View},
    gaussians::static_gaussians::InitialGaussians,
};
use omnilife_schemas::{camera::CameraModel, distances::DistanceImage};
use rayon::prelude::*;

use super::normals::{self, Points};

/// Minimum cosine of the angle between ray and normal in the size of radii.
const LEAST_COSINE: f64 = 0.1;
/// The largest radius in pitches of the pixel.
const LARGEST_RADIUS: f64 = 3.0;
/// Minimum cosine of a surface at an edge of depth; a smaller one hangs between the two sides.
const FLYING_COSINE: f64 = 0.1;
/// Minimum value of masked pixels.
pub(super) const MASKED: u8 = 128;

/// A view with its distances. All of its lists are of one size, that of the view's camera.
#[derive(Debug, Clone, Copy)]
pub struct DistanceView<'a> {
    /// The camera, in normalized units, of the size of the lists.
    pub view: &'a View,
    /// 8-bit RGB, HWC.
    pub pixels: &'a [u8],
    /// 255 in the dynamic region; those pixels are left out.
    pub mask: Option<&'a [u8]>,
    /// Not zero in the ignored region; those pixels are left out as well.
    pub ignored: Option<&'a [u8]>,
    /// Distances along the rays, normalized units.
    pub distances: &'a DistanceImage,
    /// Confidence of each distance, in [0, 1]; `None` if the source has none.
    pub confidences: Option<&'a [f32]>,
}

/// Settings of the lift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiftSettings {
    /// Standard deviations along the surface, in radii of a sample.
    pub tangential: f32,
    /// Standard deviation along the normal, in radii of a sample.
    pub normal: f32,
    /// Opacity.
    pub opacity: f32,
    /// True if pixels near the poles of a panorama are left out, so that samples are equally dense on the sphere.
    pub thins_poles: bool,
    /// Seed of the choice of pixels near the poles.
    pub seed: u64,
}

impl LiftSettings {
    /// For samples that no other view has finer: found on a scene with known distances, by steps of opacity and
    /// sizes.
    pub const OF_BEST_VIEWS: Self = Self {
        tangential: 0.6,
        normal: 0.06,
        opacity: 0.9,
        thins_poles: true,
        seed: 0,
    };
    /// For samples of all views, which overlap each other.
    pub const OF_ALL_VIEWS: Self = Self {
        tangential: 0.35,
        normal: 0.035,
        opacity: 0.99,
        thins_poles: true,
        seed: 0,
    };
}

impl LiftSettings {
    /// Returns the standard deviations of a sample of this radius.
    fn scales(&self, radius: f32) -> [f32; 3] {
        let along = self.tangential * radius;
        [along, along, self.normal * radius]
    }
}

/// Counts of the pixels of a view by their use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LiftCounts {
    /// All pixels.
    pub pixels: u64,
    /// Pixels of unknown distance.
    pub unknown: u64,
    /// Masked pixels.
    pub masked: u64,
    /// Pixels left out near the poles, where they crowd.
    pub thinned: u64,
    /// Pixels between the two sides of an edge of depth.
    pub flying: u64,
    /// Pixels kept without a normal of their own: they face the camera.
    pub without_normal: u64,
}

/// Samples of a view's surfaces; all lists are of one length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SurfaceSamples {
    /// The Gaussians, normalized units. The third axis is along the normal.
    pub gaussians: InitialGaussians,
    /// Unit normals in the world, towards the camera.
    pub normals: Vec<Vec3>,
    /// Radius of each sample: the root of its area on the surface, normalized units.
    pub radii: Vec<f32>,
    /// Number of each sample's pixel, row by row.
    pub pixels: Vec<u32>,
    /// Confidence of each distance, in [0, 1]; 1 without a source.
    pub confidences: Vec<f32>,
    /// Counts of the pixels by their use.
    pub counts: LiftCounts,
}

impl SurfaceSamples {
    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.radii.len()
    }

    /// Returns true without samples.
    pub fn is_empty(&self) -> bool {
        self.radii.is_empty()
    }

    /// Returns the same samples in another shape.
    #[must_use]
    pub fn shaped(mut self, settings: &LiftSettings) -> Self {
        let scales = self.gaussians.scales.iter_mut().zip(&self.radii);
        scales.for_each(|(scales, &radius)| *scales = settings.scales(radius));
        self.gaussians.opacities.fill(settings.opacity);
        self
    }

    /// Returns the samples whose flag is set, in their order.
    #[must_use]
    pub fn retained(&self, keep: &[bool]) -> Self {
        let indices: Vec<usize> = (0..self.len()).filter(|&index| keep[index]).collect();
        fn of<T: Copy>(values: &[T], indices: &[usize]) -> Vec<T> {
            indices.iter().map(|&index| values[index]).collect()
        }
        Self {
            gaussians: self.gaussians.selected(&indices),
            normals: of(&self.normals, &indices),
            radii: of(&self.radii, &indices),
            pixels: of(&self.pixels, &indices),
            confidences: of(&self.confidences, &indices),
            counts: self.counts,
        }
    }
}

/// Use of a pixel.
enum PixelUse {
    Unknown,
    Masked,
    Thinned,
    Flying,
    Kept(Sample),
}

struct Sample {
    position: Vec3,
    normal: Vec3,
    radius: f32,
    has_normal: bool,
}

/// Lifts the samples of a view, row by row.
///
/// `x = c + R (D r)` (PanoGS, Eq. 6). The two scales along the surface are `tangential` radii and that along the
/// normal `normal` radii (Eq. 7). The rotation brings z onto the normal by the shortest way (Eq. 8, which leaves
/// the rotation about the normal open: it has no effect). The radius is the root of a sample's area on the
/// surface, `D pitch / sqrt(cos i)`.
///
/// With thinned poles, a pixel of a panorama is kept with probability `cos(latitude)`, by a hash of its place. So
/// samples are as dense at the poles as at the equator. Otherwise samples near the poles have the same radii and
/// overlap each other.
///
/// `number` is that of the view: it keeps the views' hashes apart.
pub fn lift(view: &DistanceView<'_>, number: u64, settings: &LiftSettings) -> SurfaceSamples {
    let points = Points::new(view.view.camera, view.distances);
    let noise = normals::relative_noise(view.distances);
    let half_width = normals::window(noise, view.distances.height);
    let normals = normals::normals(&points, half_width);
    let lifter = Lifter {
        view,
        points,
        normals,
        number,
        settings,
    };
    let (width, height) = (view.distances.width, view.distances.height);
    let rows: Vec<SurfaceSamples> = (0..height)
        .into_par_iter()
        .map(|row| {
            let mut lifted = SurfaceSamples::default();
            for column in 0..width {
                lifter.add(&mut lifted, column, row);
            }
            lifted
        })
        .collect();
    let mut all = SurfaceSamples::default();
    for row in rows {
        all.append(row);
    }
    all
}

impl SurfaceSamples {
    /// Adds the samples of another view, or of more rows.
    pub fn append(&mut self, mut other: Self) {
        self.gaussians.append(other.gaussians);
        self.normals.append(&mut other.normals);
        self.radii.append(&mut other.radii);
        self.pixels.append(&mut other.pixels);
        self.confidences.append(&mut other.confidences);
        let (counts, more) = (&mut self.counts, other.counts);
        counts.pixels += more.pixels;
        counts.unknown += more.unknown;
        counts.masked += more.masked;
        counts.thinned += more.thinned;
        counts.flying += more.flying;
        counts.without_normal += more.without_normal;
    }
}

struct Lifter<'a> {
    view: &'a DistanceView<'a>,
    points: Points<'a>,
    normals: Vec<Option<Vec3>>,
    number: u64,
    settings: &'a LiftSettings,
}

impl Lifter<'_> {
    fn add(&self, lifted: &mut SurfaceSamples, column: usize, row: usize) {
        let pixel = row * self.view.distances.width + column;
        lifted.counts.pixels += 1;
        let sample = match self.pixel_use(column, row) {
            PixelUse::Unknown => return lifted.counts.unknown += 1,
            PixelUse::Masked => return lifted.counts.masked += 1,
            PixelUse::Thinned => return lifted.counts.thinned += 1,
            PixelUse::Flying => return lifted.counts.flying += 1,
            PixelUse::Kept(sample) => sample,
        };
        lifted.counts.without_normal += u64::from(!sample.has_normal);
        let gaussians = &mut lifted.gaussians;
        let colour = &self.view.pixels[3 * pixel..3 * pixel + 3];
        gaussians.positions.push(sample.position.to_array());
        gaussians.scales.push(self.settings.scales(sample.radius));
        gaussians.rotations.push(z_onto(sample.normal));
        gaussians
            .colours
            .push([0, 1, 2].map(|channel| f32::from(colour[channel]) / 255.0));
        gaussians.opacities.push(self.settings.opacity);
        lifted.normals.push(sample.normal);
        lifted.radii.push(sample.radius);
        lifted.pixels.push(pixel as u32);
        let confidences = self.view.confidences;
        lifted
            .confidences
            .push(confidences.map_or(1.0, |all| all[pixel]));
    }

    fn pixel_use(&self, column: usize, row: usize) -> PixelUse {
        let view = self.view;
        let pixel = row * view.distances.width + column;
        let distance = view.distances.values[pixel];
        if distance <= 0.0 {
            return PixelUse::Unknown;
        }
        if view.hides(pixel) {
            return PixelUse::Masked;
        }
        if share([self.number, row as u64, column as u64, self.settings.seed])
            >= self.kept_share(row)
        {
            return PixelUse::Thinned;
        }
        let ray = self.points.ray(column, row);
        let normal = self.normals[pixel].map(Vec3::as_dvec3);
        let cosine = normal.map_or(1.0, |normal| normal.dot(ray).abs());
        let [is_behind, is_before] = edges(&self.points, column, row);
        let is_grazed = cosine < FLYING_COSINE && (is_behind || is_before);
        // A thin object in front of a wall has no normal either, but its neighbours are farther.
        let hangs_between = normal.is_none() && is_behind && is_before;
        if is_grazed || hangs_between {
            return PixelUse::Flying;
        }
        let pitch = f64::from(distance) * pixel_angle(&view.view.camera, ray);
        let radius = sample_radius(pitch, cosine);
        let to_world = view.view.rotation.as_dmat3().transpose();
        let place = view.view.centre.as_dvec3() + to_world * (ray * f64::from(distance));
        PixelUse::Kept(Sample {
            position: place.as_vec3(),
            normal: (to_world * normal.unwrap_or(-ray))
                .as_vec3()
                .normalize_or(Vec3::Z),
            radius: radius as f32,
            has_normal: normal.is_some(),
        })
    }

    /// Returns the share of the pixels of a row that is kept: `cos(latitude)` in a panorama with thinned poles.
    fn kept_share(&self, row: usize) -> f64 {
        match self.view.view.camera {
            Camera::Erp(camera) if self.settings.thins_poles => {
                let latitude = (0.5 - (row as f64 + 0.5) / f64::from(camera.height)) * PI;
                latitude.cos()
            }
            Camera::Erp(_) | Camera::Pinhole(_) => 1.0,
        }
    }
}

/// Returns two flags: a neighbour above, below, left or right is on a nearer surface, and on a farther one.
fn edges(points: &Points<'_>, column: usize, row: usize) -> [bool; 2] {
    let own = points.distance(column, row);
    let neighbours = [[1, 0], [-1, 0], [0, 1], [0, -1]]
        .iter()
        .filter_map(|&step| points.neighbour([column, row], step))
        .map(|[column, row]| points.distance(column, row))
        .filter(|&distance| distance > 0.0 && !Points::are_close(own, distance));
    neighbours.fold([false; 2], |[behind, before], distance| {
        [behind || distance < own, before || distance > own]
    })
}

/// Returns the root of the area that a sample stands for on its surface, in the unit of its `pitch` across the ray;
/// `cosine` is that between ray and normal, 0 to 1.
fn sample_radius(pitch: f64, cosine: f64) -> f64 {
    (pitch / cosine.max(LEAST_COSINE).sqrt()).min(LARGEST_RADIUS * pitch)
}

/// Returns the root of the solid angle of a kept pixel in the direction of a unit ray, radians.
pub(super) fn pixel_angle(camera: &Camera, ray: DVec3) -> f64 {
    match camera {
        Camera::Erp(camera) => {
            (TAU / f64::from(camera.width) * PI / f64::from(camera.height)).sqrt()
        }
        // d(omega) = cos^3 du dv / (fx fy)
        Camera::Pinhole(camera) => (ray.z.powi(3) / (camera.fx * camera.fy)).sqrt(),
    }
}

/// Returns the solid angle of a pixel, steradians.
pub(crate) fn pixel_steradians(camera: &Camera, pixel: usize) -> f64 {
    let width = camera.size()[0];
    let (column, row) = (pixel % width, pixel / width);
    match camera {
        Camera::Erp(camera) => camera.pixel_solid_angle(row as u32),
        Camera::Pinhole(camera) => {
            let direction = camera.unproject(dvec2(column as f64 + 0.5, row as f64 + 0.5));
            direction.z.powi(3) / (camera.fx * camera.fy)
        }
    }
}

/// Returns `|n . r|` of the surface under each pixel of a view, as input of the fusion of views. It is 0 at
/// unknown or masked distances, without a normal, and at edges of depth.
pub fn incidence(view: &DistanceView<'_>) -> Vec<f32> {
    let points = Points::new(view.view.camera, view.distances);
    let noise = normals::relative_noise(view.distances);
    let half_width = normals::window(noise, view.distances.height);
    let normals = normals::normals(&points, half_width);
    let width = view.distances.width;
    let of_pixel = |(pixel, normal): (usize, &Option<Vec3>)| {
        let (column, row) = (pixel % width, pixel / width);
        let is_out = view.hides(pixel) || edges(&points, column, row) != [false; 2];
        match normal {
            Some(normal) if !is_out => points.ray(column, row).as_vec3().dot(*normal).abs(),
            _ => 0.0,
        }
    };
    normals.par_iter().enumerate().map(of_pixel).collect()
}

/// Returns the unit quaternion (w, x, y, z) that brings z onto a unit normal by the shortest way:
/// `(1 + n_z, -n_y, n_x, 0)`; half a rotation about x where the normal is -z.
pub fn z_onto(normal: Vec3) -> [f32; 4] {
    let w = 1.0 + normal.z;
    if w < 1e-6 {
        return [0.0, 1.0, 0.0, 0.0];
    }
    let length = (w * w + normal.x * normal.x + normal.y * normal.y).sqrt();
    [w / length, -normal.y / length, normal.x / length, 0.0]
}

/// Returns a number in [0, 1) that depends on the words alone (`SplitMix64`).
fn share(words: [u64; 4]) -> f64 {
    let mixed = words.into_iter().fold(0, |state: u64, word| {
        let mut z = (state ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    });
    (mixed >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use glam::{Quat, vec3};

    use super::*;

    #[test]
    fn z_is_brought_onto_any_normal() {
        for normal in [
            Vec3::Z,
            Vec3::NEG_Z,
            Vec3::X,
            vec3(0.3, -0.5, -0.9).normalize(),
            vec3(1e-4, 0.0, -1.0).normalize(),
            vec3(1e-3, 2e-3, -1.0).normalize(),
        ] {
            let [w, x, y, z] = z_onto(normal);
            let turned = Quat::from_xyzw(x, y, z, w) * Vec3::Z;
            assert!(turned.distance(normal) < 2e-3, "{normal} {turned}");
        }
    }

    #[test]
    fn shares_are_even_and_depend_on_every_word() {
        let count = 20_000;
        let mean = (0..count)
            .map(|at| share([1, at / 200, at % 200, 9]))
            .sum::<f64>();
        // Three standard deviations of the mean of that many even numbers.
        let expected = 3.0 / (12.0 * count as f64).sqrt();
        assert!((mean / count as f64 - 0.5).abs() < expected);
        let base = share([1, 2, 3, 4]);
        for other in [[0, 2, 3, 4], [1, 0, 3, 4], [1, 2, 0, 4], [1, 2, 3, 0]] {
            assert!((share(other) - base).abs() > 1e-9);
        }
    }
}
