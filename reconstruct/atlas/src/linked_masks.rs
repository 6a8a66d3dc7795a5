//! Objects from one mask per frame: connected pieces, linked from frame to frame.
//!
//! Pieces of neighbouring frames are the same object where they overlap most; columns of panoramas wrap.
//! Tracks of fewer than three frames, and those below 0.05 % of the image in their largest frame, stay in
//! the background.

use omnilife_training::scene::mask_pieces::{Piece, pieces};

/// Minimum coverage of a marked pixel, of 255.
const MARKED: u8 = 128;
/// Minimum number of frames of an object.
const LEAST_FRAMES: usize = 3;
/// Minimum share of the image in an object's largest frame.
const LEAST_SHARE: f64 = 5e-4;
/// Minimum intersection over union of pieces of the same object.
const LEAST_OVERLAP: f64 = 0.1;

/// Returns the masks of the objects that are found: for each object, one for each frame.
pub fn linked(
    masks: &[Option<&[u8]>],
    [width, height]: [usize; 2],
    wraps: bool,
) -> Vec<Vec<Option<Vec<u8>>>> {
    let mut tracks: Vec<Vec<Option<Piece>>> = Vec::new();
    for (frame, mask) in masks.iter().enumerate() {
        let mut found = mask.map_or_else(Vec::new, |mask| {
            pieces(mask, [width, height], wraps, MARKED)
        });
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (track, past) in tracks.iter().enumerate() {
            let Some(Some(last)) = past.last() else {
                continue;
            };
            for (piece, pixels) in found.iter().enumerate() {
                let overlap = overlap(last, pixels);
                if overlap >= LEAST_OVERLAP {
                    pairs.push((overlap, track, piece));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        for track in &mut tracks {
            track.push(None);
        }
        let mut is_taken = vec![false; found.len()];
        for (_, track, piece) in pairs {
            let slot = tracks[track].last_mut();
            if let Some(slot @ None) = slot
                && !is_taken[piece]
            {
                *slot = Some(std::mem::take(&mut found[piece]));
                is_taken[piece] = true;
            }
        }
        for (piece, _) in found.into_iter().zip(is_taken).filter(|(_, taken)| !taken) {
            let mut track = vec![None; frame];
            track.push(Some(piece));
            tracks.push(track);
        }
    }
    let is_object = |track: &Vec<Option<Piece>>| {
        let pieces = track.iter().flatten();
        let largest = pieces.clone().map(Vec::len).max().unwrap_or(0);
        pieces.count() >= LEAST_FRAMES && largest as f64 >= LEAST_SHARE * (width * height) as f64
    };
    let as_mask = |piece: &Piece| {
        let mut mask = vec![0; width * height];
        for &pixel in piece {
            mask[pixel] = 255;
        }
        mask
    };
    let of_track = |track: Vec<Option<Piece>>| -> Vec<Option<Vec<u8>>> {
        track
            .iter()
            .map(|piece| piece.as_ref().map(as_mask))
            .collect()
    };
    tracks.into_iter().filter(is_object).map(of_track).collect()
}

/// Returns the intersection over union of sorted pixels.
fn overlap(a: &Piece, b: &Piece) -> f64 {
    let both = a
        .iter()
        .filter(|pixel| b.binary_search(pixel).is_ok())
        .count();
    both as f64 / (a.len() + b.len() - both).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_joined_across_the_seam_and_linked_over_frames() {
        let size = [20, 10];
        // One object across the seam that goes right, one speck in a single frame.
        let mask = |shift: usize, speck: bool| {
            let mut mask = vec![0; 200];
            for column in 18..23 {
                for row in 3..6 {
                    mask[row * 20 + (column + shift) % 20] = 255;
                }
            }
            if speck {
                mask[9 * 20 + 10] = 255;
            }
            mask
        };
        let masks: Vec<Vec<u8>> = (0..4).map(|frame| mask(frame, frame == 2)).collect();
        let given: Vec<Option<&[u8]>> = masks.iter().map(|mask| Some(&mask[..])).collect();
        let objects = linked(&given, size, true);
        assert_eq!(objects.len(), 1);
        let counts = objects[0].iter().map(|mask| {
            let mask = mask.as_ref().expect("seen in every frame");
            mask.iter().filter(|&&byte| byte > 0).count()
        });
        assert_eq!(counts.collect::<Vec<_>>(), [15; 4]);
        // Without the seam the first frame has two pieces, of which one is soon out of sight.
        let objects = linked(&given, size, false);
        assert_eq!(objects.len(), 1);
        let first = objects[0][0].as_ref().expect("seen in the first frame");
        assert_eq!(first.iter().filter(|&&byte| byte > 0).count(), 9);
        assert!(linked(&[None, None, None], size, true).is_empty());
    }
}
