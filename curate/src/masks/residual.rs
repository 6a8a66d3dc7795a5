//! What moves, from the flow that the camera's own motion does not explain.
//!
//! Each frame is compared with one a little before and one a little after. What moves along the
//! camera's own way, with it, is not told from a nearer or farther still thing: overtaken and
//! overtaking vehicles are missed for the time that they are in line. It needs no weights and knows
//! no classes; where there are masks of a segmentation network, those are better.

use std::path::Path;

use glam::Vec3;
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    progress::Progress,
    records::Sequence,
    rgb::Mask,
};

use super::MaskMethod;
use crate::{
    error::CurateError,
    motion::{GreySphere, align, explain, flow},
};

/// The method.
pub const METHOD: MaskMethod = MaskMethod {
    id: "residual",
    about: "flow that the camera's own motion does not explain; no weights needed",
    settings,
    find,
};

/// Columns of the pictures that are compared.
const PICTURE_WIDTH: usize = 512;
/// The grid on which motion is decided.
const GRID: ErpCamera = ErpCamera {
    width: 192,
    height: 96,
};
/// Frames are compared over at least this long, seconds: slow motion needs time to show.
const LEAST_GAP_SECONDS: f64 = 0.1;
/// Of the 9 grid points around one, so many have to move for it to count.
const LEAST_NEIGHBOURS: usize = 5;

fn settings() -> String {
    format!(
        "{PICTURE_WIDTH} px, grid {}x{}, {LEAST_GAP_SECONDS} s before and after, {LEAST_NEIGHBOURS} \
         of 9",
        GRID.width, GRID.height
    )
}

fn find(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Vec<Mask>, CurateError> {
    let entries = &sequence.frames.entries;
    if entries.len() < 2 {
        return Err(CurateError::input(
            folder,
            "has a single frame, so nothing shows motion",
        ));
    }
    let times: Vec<f64> = entries.iter().map(|entry| entry.time_seconds).collect();
    let directions = grid_directions();
    let size = (
        sequence.frames.width as usize,
        sequence.frames.height as usize,
    );
    progress.begin("motion masks", Some(entries.len() as u64));
    let mut held = Pictures::new(folder, sequence);
    let masks = (0..entries.len())
        .map(|index| {
            let mut votes = Votes::new();
            for other in compared_with(&times, index) {
                held.load(index)?;
                held.load(other)?;
                if let (Some(this), Some(that)) = (held.get(index), held.get(other)) {
                    votes.add(this, that, &directions);
                }
            }
            held.forget_before(&times, index);
            progress.advance(1);
            Ok(votes.mask().resized_to_nearest(size.0, size.1))
        })
        .collect();
    progress.end();
    masks
}

/// The nearest frames that are far enough before and after one; the farthest there is where the
/// sequence is too short.
fn compared_with(times: &[f64], index: usize) -> Vec<usize> {
    let now = times[index];
    let before = (0..index)
        .rev()
        .find(|&i| now - times[i] >= LEAST_GAP_SECONDS - 1e-6);
    let after = (index + 1..times.len()).find(|&i| times[i] - now >= LEAST_GAP_SECONDS - 1e-6);
    let mut others: Vec<usize> = before.into_iter().chain(after).collect();
    if others.is_empty() {
        others.push(if index == 0 { times.len() - 1 } else { 0 });
    }
    others
}

fn grid_directions() -> Vec<Vec3> {
    (0..GRID.height)
        .flat_map(|row| (0..GRID.width).map(move |column| (column, row)))
        .map(|(column, row)| {
            let pixel = glam::dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
            GRID.unproject(pixel).as_vec3()
        })
        .collect()
}

/// Pictures of the frames that are being compared.
struct Pictures<'a> {
    folder: &'a Path,
    sequence: &'a Sequence,
    held: Vec<Option<GreySphere>>,
}

impl<'a> Pictures<'a> {
    fn new(folder: &'a Path, sequence: &'a Sequence) -> Self {
        Self {
            folder,
            sequence,
            held: vec![None; sequence.frames.entries.len()],
        }
    }

    fn load(&mut self, index: usize) -> Result<(), CurateError> {
        if self.held[index].is_none() {
            let file = &self.sequence.frames.entries[index].file;
            let image = RgbImage::read(&self.folder.join(file))?;
            let width = PICTURE_WIDTH.min(image.width);
            self.held[index] = Some(GreySphere::new(&image, width));
        }
        Ok(())
    }

    fn get(&self, index: usize) -> Option<&GreySphere> {
        self.held[index].as_ref()
    }

    /// Drops what no later frame is compared with.
    fn forget_before(&mut self, times: &[f64], index: usize) {
        let next = (index + 1).min(times.len() - 1);
        let oldest = compared_with(times, next).into_iter().min().unwrap_or(next);
        for held in &mut self.held[..oldest.min(index)] {
            *held = None;
        }
    }
}

/// How often each grid point was seen to move.
struct Votes {
    moving: Vec<u8>,
    seen: Vec<u8>,
}

impl Votes {
    fn new() -> Self {
        let count = (GRID.width * GRID.height) as usize;
        Self {
            moving: vec![0; count],
            seen: vec![0; count],
        }
    }

    fn add(&mut self, this: &GreySphere, that: &GreySphere, directions: &[Vec3]) {
        let rotation = align(this, that);
        let flow = flow(this, that, rotation, directions);
        let motion = explain(&flow, this.pixel_radians(0));
        for index in 0..directions.len() {
            if let Some(moves) = motion.is_dynamic(index) {
                self.seen[index] += 1;
                self.moving[index] += u8::from(moves);
            }
        }
    }

    /// Points that moved whenever they were seen, less those without neighbours that did.
    fn mask(&self) -> Mask {
        let (width, height) = (GRID.width as usize, GRID.height as usize);
        let moves = |x: usize, y: usize| {
            let at = y * width + x;
            self.seen[at] > 0 && self.moving[at] == self.seen[at]
        };
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let neighbours = (0..9)
                    .filter(|index| {
                        let column = (x + width + index % 3 - 1) % width;
                        let row = (y + index / 3).saturating_sub(1).min(height - 1);
                        moves(column, row)
                    })
                    .count();
                data.push(if neighbours >= LEAST_NEIGHBOURS {
                    255
                } else {
                    0
                });
            }
        }
        Mask {
            width,
            height,
            data,
        }
    }
}
