//! Transfer of points on the rays of one frame to the pixels of another.

use glam::{DMat3, DVec3, Mat3, Vec3};
use omnilife_schemas::{
    camera::{Camera, CameraModel, PinholeCamera},
    posed_view::PosedView,
};

/// Unit directions of a camera's pixels, in its own frame, row by row.
pub(super) struct Rays {
    width: usize,
    /// Their x, y and z.
    axes: [Vec<f32>; 3],
}

impl Rays {
    /// Computes those through the centres of a camera's pixels.
    pub(super) fn of(camera: &Camera) -> Self {
        let [width, height] = camera.size();
        let mut axes = [0; 3].map(|_| Vec::with_capacity(width * height));
        for pixel in 0..width * height {
            let centre = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let ray = camera.unproject(centre).as_vec3().to_array();
            for (axis, value) in axes.iter_mut().zip(ray) {
                axis.push(value);
            }
        }
        Self { width, axes }
    }

    #[inline]
    pub(super) fn at(&self, pixel: usize) -> Vec3 {
        let [x, y, z] = &self.axes;
        Vec3::new(x[pixel], y[pixel], z[pixel])
    }

    fn row(&self, row: usize) -> [&[f32]; 3] {
        let pixels = row * self.width..(row + 1) * self.width;
        [0, 1, 2].map(|axis| &self.axes[axis][pixels.clone()])
    }
}

/// Projections of a row of points: column and row counted from the centre of the first pixel, and distance. NaN for
/// points outside the image.
pub(super) struct Places {
    pub(super) columns: Vec<f32>,
    pub(super) rows: Vec<f32>,
    pub(super) away: Vec<f32>,
}

impl Places {
    /// Creates an empty row.
    pub(super) fn new(width: usize) -> Self {
        let unknown = || vec![f32::NAN; width];
        Self {
            columns: unknown(),
            rows: unknown(),
            away: unknown(),
        }
    }
}

/// From points on the rays of one frame to the pixels of another.
///
/// Places far from the world's origin are kept in f64; between two frames of one scene f32 is accurate to a thousandth
/// of a pixel.
pub(super) struct Transfer {
    rotation: Mat3,
    offset: Vec3,
    lens: Lens,
}

/// Projection of points to pixels.
enum Lens {
    Pinhole(PinholeLens),
    Other(Camera),
}

/// Focal lengths and the principal point, which is counted from the centre of the first pixel; pixels.
#[derive(Clone, Copy)]
struct PinholeLens {
    focal: [f32; 2],
    middle: [f32; 2],
}

impl From<PinholeCamera> for PinholeLens {
    fn from(camera: PinholeCamera) -> Self {
        Self {
            focal: [camera.fx as f32, camera.fy as f32],
            middle: [(camera.cx - 0.5) as f32, (camera.cy - 0.5) as f32],
        }
    }
}

impl Transfer {
    /// Creates the transfer from a frame to another.
    pub(super) fn new(from: &PosedView, to: &PosedView) -> Self {
        let to_camera: DMat3 = to.to_world.transpose();
        let offset: DVec3 = to_camera * (from.centre - to.centre);
        Self {
            rotation: (to_camera * from.to_world).as_mat3(),
            offset: offset.as_vec3(),
            lens: match to.camera {
                Camera::Pinhole(camera) => Lens::Pinhole(camera.into()),
                other @ Camera::Erp(_) => Lens::Other(other),
            },
        }
    }

    /// Returns the projection of the point on a ray at a distance, with the conventions of [`Places`]; NaN if there is
    /// none.
    #[inline]
    pub(super) fn place(&self, ray: Vec3, distance: f32) -> [f32; 3] {
        let point = moved(self.rotation, self.offset, ray, distance);
        match &self.lens {
            Lens::Pinhole(lens) => pinhole_place(*lens, point),
            Lens::Other(camera) => other_place(camera, point),
        }
    }

    /// Projects a row of points.
    pub(super) fn row(&self, rays: &Rays, row: usize, distances: &[f32], places: &mut Places) {
        let rays = rays.row(row);
        match &self.lens {
            Lens::Pinhole(lens) => {
                pinhole_row((self.rotation, self.offset), *lens, rays, distances, places);
            }
            Lens::Other(camera) => {
                let [x, y, z] = rays;
                for (column, &distance) in distances.iter().enumerate() {
                    let ray = Vec3::new(x[column], y[column], z[column]);
                    let point = moved(self.rotation, self.offset, ray, distance);
                    let [at_column, at_row, away] = other_place(camera, point);
                    places.columns[column] = at_column;
                    places.rows[column] = at_row;
                    places.away[column] = away;
                }
            }
        }
    }
}

#[inline(always)]
fn moved(rotation: Mat3, offset: Vec3, ray: Vec3, distance: f32) -> Vec3 {
    let [a, b, c] = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
    Vec3::new(
        (a.x * ray.x + b.x * ray.y + c.x * ray.z) * distance + offset.x,
        (a.y * ray.x + b.y * ray.y + c.y * ray.z) * distance + offset.y,
        (a.z * ray.x + b.z * ray.y + c.z * ray.z) * distance + offset.z,
    )
}

#[inline(always)]
fn pinhole_place(lens: PinholeLens, point: Vec3) -> [f32; 3] {
    // Points behind the camera are not visible.
    let inverse = if point.z > 0.0 {
        1.0 / point.z
    } else {
        f32::NAN
    };
    let away = (point.x * point.x + point.y * point.y + point.z * point.z).sqrt();
    [
        lens.focal[0] * point.x * inverse + lens.middle[0],
        lens.focal[1] * point.y * inverse + lens.middle[1],
        away,
    ]
}

fn other_place(camera: &Camera, point: Vec3) -> [f32; 3] {
    camera
        .project(point.as_dvec3())
        .map_or([f32::NAN; 3], |pixel| {
            let pixel = pixel - 0.5;
            [pixel.x as f32, pixel.y as f32, point.length()]
        })
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn pinhole_row(
    (rotation, offset): (Mat3, Vec3),
    lens: PinholeLens,
    [x, y, z]: [&[f32]; 3],
    distances: &[f32],
    places: &mut Places,
) {
    let rays = x.iter().zip(y).zip(z).zip(distances);
    let columns = places.columns.iter_mut().zip(&mut places.rows);
    let places = columns.zip(&mut places.away);
    for ((((x, y), z), distance), ((column, row), away)) in rays.zip(places) {
        let point = moved(rotation, offset, Vec3::new(*x, *y, *z), *distance);
        [*column, *row, *away] = pinhole_place(lens, point);
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, dvec2, dvec3};
    use omnilife_schemas::camera::ErpCamera;

    use super::*;

    /// Returns two frames some way apart, far from the world's origin, as national grids are.
    fn views(camera: Camera) -> [PosedView; 2] {
        let looks_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let turned = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.2, -0.1, 0.5));
        let origin = dvec3(3.9e5, 5.8e6, 40.0);
        let view = |centre: DVec3, to_world: DMat3| PosedView {
            frame: 0,
            seconds: 0.0,
            camera,
            to_world,
            centre,
        };
        [
            view(origin, looks_down),
            view(origin + dvec3(6.0, -4.0, 1.5), looks_down * turned),
        ]
    }

    #[test]
    fn points_are_seen_where_the_cameras_say() {
        let pinhole = PinholeCamera::with_horizontal_field_of_view(64, 36, 1.1);
        let erp = ErpCamera {
            width: 64,
            height: 32,
        };
        for camera in [Camera::Pinhole(pinhole), Camera::Erp(erp)] {
            let [here, there] = views(camera);
            let [width, height] = camera.size();
            let (transfer, rays) = (Transfer::new(&here, &there), Rays::of(&camera));
            let (mut places, mut seen) = (Places::new(width), 0);
            for row in 0..height {
                let distances: Vec<f32> = (0..width)
                    .map(|column| match column {
                        9 => f32::NAN,
                        _ => 25.0 + ((row * 31 + column * 17) % 40) as f32,
                    })
                    .collect();
                transfer.row(&rays, row, &distances, &mut places);
                for (column, &distance) in distances.iter().enumerate() {
                    let centre = dvec2(column as f64 + 0.5, row as f64 + 0.5);
                    let world = here.centre + here.ray(centre) * f64::from(distance);
                    let expected = there.camera.project(there.in_camera(world));
                    let [at_column, at_row] = [places.columns[column], places.rows[column]];
                    let alone = transfer.place(rays.at(row * width + column), distance);
                    let Some(expected) = expected.filter(|_| distance.is_finite()) else {
                        assert!(at_column.is_nan() && alone[0].is_nan(), "{at_column}");
                        continue;
                    };
                    seen += 1;
                    let own = dvec2(f64::from(at_column), f64::from(at_row)) + 0.5;
                    assert!(own.distance(expected) < 1e-3, "{own} {expected}");
                    let away = world.distance(there.centre);
                    assert!((f64::from(places.away[column]) / away - 1.0).abs() < 1e-5);
                    assert_eq!(alone, [at_column, at_row, places.away[column]]);
                }
            }
            assert!(seen > width * height / 2, "{seen}");
        }
    }

    #[test]
    fn what_is_behind_a_pinhole_is_not_seen() {
        let pinhole = PinholeCamera::with_horizontal_field_of_view(64, 36, 1.1);
        let [here, _] = views(pinhole.into());
        let away = PosedView {
            to_world: DMat3::IDENTITY,
            ..here
        };
        let rays = Rays::of(&here.camera);
        let [column, row, _] = Transfer::new(&here, &away).place(rays.at(64 * 18 + 32), 40.0);
        assert!(column.is_nan() && row.is_nan());
    }
}
