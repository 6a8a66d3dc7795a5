//! Shares of rendered views that no input view saw, by the scene's points: the same measure for models of every kind.
//!
//! A view is divided into cells, 64 along its longer side. The surface of a cell is at the distance of its nearest
//! point; a cell without points has the distance of the nearest cell with one, and a view without points that of the
//! farthest point. A surface is seen where it lies in the image of an input view and at most 10 % beyond the surface of
//! that view, within one cell. Cells of panoramas count by their solid angle. Surfaces with fewer points than cells
//! hide nothing, so that the share is a lower bound for scenes with sparse points.

use std::collections::VecDeque;

use glam::{DMat3, DVec3, dvec2};
use omnilife_engine::camera::Camera;
use omnilife_schemas::{Pose, camera::CameraModel};
use rayon::prelude::*;

/// Definition in records.
pub(super) const DEFINITION: &str = "share of the view whose surface, by the scene's points in cells of a 64th of \
                                     the longer side, is outside of the image of every input view or more than \
                                     10 % behind the surface there";

/// Cells along the longer side of a view.
const CELLS: u64 = 64;
/// Maximum number of points; of more, an even selection is used.
const MOST_POINTS: usize = 200_000;
/// Largest distance of a seen surface, in units of the distance of the input view's own.
const TOLERANCE: f64 = 1.1;

pub(super) struct InputViews {
    views: Vec<CoarseView>,
    points: Vec<DVec3>,
}

impl InputViews {
    /// Returns the surfaces of views; `None` without points or poses.
    pub(super) fn new(camera: Camera, poses: &[Pose], points: &[DVec3]) -> Option<Self> {
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<DVec3> = points.iter().copied().step_by(step).collect();
        let views = poses.par_iter();
        let views: Vec<CoarseView> = views
            .filter_map(|pose| CoarseView::new(camera, pose, &points))
            .collect();
        (!views.is_empty() && !points.is_empty()).then_some(Self { views, points })
    }

    /// Returns the shares in [0, 1] of views that no input view saw; `None` for a view without a usable pose.
    pub(super) fn unseen_shares(&self, camera: Camera, poses: &[Pose]) -> Vec<Option<f64>> {
        let poses = poses.par_iter();
        poses
            .map(|pose| Some(self.unseen_share(&CoarseView::new(camera, pose, &self.points)?)))
            .collect()
    }

    fn unseen_share(&self, view: &CoarseView) -> f64 {
        let (mut unseen, mut all) = (0.0, 0.0);
        for cell in 0..view.distances.len() {
            let weight = view.weight(cell);
            let surface = view.surface(cell);
            all += weight;
            if !self.views.iter().any(|given| given.sees(surface)) {
                unseen += weight;
            }
        }
        unseen / all
    }
}

/// View with the distance of a surface in each cell.
struct CoarseView {
    /// Camera whose pixels are the cells.
    camera: Camera,
    to_world: DMat3,
    centre: DVec3,
    /// Row by row, world units.
    distances: Vec<f64>,
}

impl CoarseView {
    /// Returns the view of some points; `None` for an unusable pose or without points.
    fn new(camera: Camera, pose: &Pose, points: &[DVec3]) -> Option<Self> {
        let longer = u64::from(camera.width().max(camera.height()).max(1));
        let cells = |side: u32| (u64::from(side) * CELLS).div_ceil(longer).max(1) as u32;
        let camera = camera.resized(cells(camera.width()), cells(camera.height()));
        let mut view = Self {
            camera,
            to_world: DMat3::from_quat(pose.rotation()?),
            centre: pose.centre(),
            distances: vec![f64::INFINITY; camera.size()[0] * camera.size()[1]],
        };
        for &point in points {
            if let Some([column, row]) = view.cell(point) {
                let nearest = &mut view.distances[row * camera.size()[0] + column];
                *nearest = nearest.min(point.distance(view.centre));
            }
        }
        let distances = points.iter().map(|point| point.distance(view.centre));
        let farthest = distances.fold(0.0, f64::max);
        if farthest <= 0.0 {
            return None;
        }
        view.fill(farthest);
        Some(view)
    }

    /// Returns column and row of the cell of a point; `None` outside of the image.
    fn cell(&self, point: DVec3) -> Option<[usize; 2]> {
        let in_camera = self.to_world.transpose() * (point - self.centre);
        let pixel = self.camera.project(in_camera)?;
        let [width, height] = self.camera.size();
        let is_inside =
            pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x <= width as f64 && pixel.y <= height as f64;
        is_inside.then(|| {
            [
                (pixel.x as usize).min(width - 1),
                (pixel.y as usize).min(height - 1),
            ]
        })
    }

    /// Returns the neighbours of a cell along columns and rows; columns of panoramas wrap.
    fn beside(&self, [column, row]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> + use<> {
        let [width, height] = self.camera.size();
        let wraps = self.camera.wraps();
        let left = (wraps || column > 0).then(|| (column + width - 1) % width);
        let right = (wraps || column + 1 < width).then(|| (column + 1) % width);
        let above = row.checked_sub(1);
        let below = (row + 1 < height).then_some(row + 1);
        let columns = left.into_iter().chain(right);
        let rows = above.into_iter().chain(below);
        let columns = columns.map(move |column| [column, row]);
        columns.chain(rows.map(move |row| [column, row]))
    }

    /// Gives empty cells the distance of the nearest cell with one, all of them `farthest` in a view without points.
    fn fill(&mut self, farthest: f64) {
        let width = self.camera.size()[0];
        let known = (0..self.distances.len()).filter(|&cell| self.distances[cell].is_finite());
        let mut open: VecDeque<usize> = known.collect();
        if open.is_empty() {
            self.distances.fill(farthest);
        }
        while let Some(cell) = open.pop_front() {
            for [column, row] in self.beside([cell % width, cell / width]) {
                let other = row * width + column;
                if self.distances[other].is_infinite() {
                    self.distances[other] = self.distances[cell];
                    open.push_back(other);
                }
            }
        }
    }

    /// Returns the place of a cell's surface in the world.
    fn surface(&self, cell: usize) -> DVec3 {
        let width = self.camera.size()[0];
        let middle = dvec2((cell % width) as f64 + 0.5, (cell / width) as f64 + 0.5);
        self.centre + self.distances[cell] * (self.to_world * self.camera.unproject(middle))
    }

    fn weight(&self, cell: usize) -> f64 {
        let [width, _] = self.camera.size();
        match self.camera {
            Camera::Erp(camera) => camera.pixel_solid_angle((cell / width) as u32),
            Camera::Pinhole(_) => 1.0,
        }
    }

    /// Returns true where a surface is in the image and not behind that of the view.
    fn sees(&self, surface: DVec3) -> bool {
        let Some(cell) = self.cell(surface) else {
            return false;
        };
        let width = self.camera.size()[0];
        let around = self.beside(cell).chain([cell]);
        let own = around
            .map(|[column, row]| self.distances[row * width + column])
            .fold(0.0, f64::max);
        surface.distance(self.centre) <= TOLERANCE * own
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, dvec3};
    use omnilife_schemas::camera::{ErpCamera, PinholeCamera};

    use super::*;

    fn pinhole() -> Camera {
        PinholeCamera::with_horizontal_field_of_view(640, 640, std::f64::consts::FRAC_PI_2).into()
    }

    /// A wall at z = 4, 40 wide and high.
    fn wall() -> Vec<DVec3> {
        let at = |n: u32| 0.2 * f64::from(n) - 20.0;
        let rows = (0..=200).flat_map(|y| (0..=200).map(move |x| [x, y]));
        rows.map(|[x, y]| dvec3(at(x), at(y), 4.0)).collect()
    }

    fn pose(turn: f64, centre: DVec3) -> Pose {
        Pose::new(DQuat::from_rotation_y(turn), centre)
    }

    fn share(camera: Camera, points: &[DVec3], at: Pose) -> f64 {
        let given = InputViews::new(pinhole(), &[pose(0.0, DVec3::ZERO)], points);
        let shares = given.expect("points").unseen_shares(camera, &[at]);
        shares[0].expect("a pose")
    }

    #[test]
    fn the_share_is_that_of_the_surface_outside_of_the_given_image() {
        let wall = wall();
        let of = |pose| share(pinhole(), &wall, pose);
        assert_eq!(of(pose(0.0, DVec3::ZERO)), 0.0);
        // Half of the image is beside that of the input view, which is 8 wide on the wall.
        let beside = of(pose(0.0, dvec3(4.0, 0.0, 0.0)));
        assert!((beside - 0.5).abs() < 0.03, "{beside}");
        assert_eq!(of(pose(std::f64::consts::PI, DVec3::ZERO)), 1.0);
        // An input view of a sixth of the sphere.
        let sphere = ErpCamera::new(128, 64);
        let around = share(sphere.into(), &wall, pose(0.0, DVec3::ZERO));
        assert!((around - 5.0 / 6.0).abs() < 0.05, "{around}");
    }

    #[test]
    fn hidden_surfaces_are_unseen() {
        let mut points = wall();
        // A screen at z = 1 before the given camera hides all of the wall that it would show.
        for x in -75..=75 {
            points.extend((-75..=75).map(|y| dvec3(f64::from(x) / 50.0, f64::from(y) / 50.0, 1.0)));
        }
        let behind_the_screen = share(pinhole(), &points, pose(0.0, dvec3(0.0, 0.0, 2.0)));
        assert_eq!(behind_the_screen, 1.0);
    }

    #[test]
    fn without_points_there_is_no_measure() {
        assert!(InputViews::new(pinhole(), &[pose(0.0, DVec3::ZERO)], &[]).is_none());
    }
}
