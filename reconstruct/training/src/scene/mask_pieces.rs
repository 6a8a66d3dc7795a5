//! Connected pieces of masks.

/// A piece of a mask: its pixels in order.
pub type Piece = Vec<usize>;

/// Returns the pieces of a mask of `width` x `height` pixels that are connected by sides, among pixels of at
/// least `least`. If the mask wraps, the first column follows the last.
pub fn pieces(mask: &[u8], [width, height]: [usize; 2], wraps: bool, least: u8) -> Vec<Piece> {
    let mut is_open: Vec<bool> = mask.iter().map(|&byte| byte >= least).collect();
    let mut found = Vec::new();
    for first in 0..mask.len() {
        if !is_open[first] {
            continue;
        }
        let mut piece = Vec::new();
        let mut left = vec![first];
        is_open[first] = false;
        while let Some(pixel) = left.pop() {
            piece.push(pixel);
            let (column, row) = (pixel % width, pixel / width);
            let beside = [
                (column > 0 || wraps).then(|| row * width + (column + width - 1) % width),
                (column + 1 < width || wraps).then(|| row * width + (column + 1) % width),
                (row > 0).then(|| pixel - width),
                (row + 1 < height).then(|| pixel + width),
            ];
            for next in beside.into_iter().flatten() {
                if is_open[next] {
                    is_open[next] = false;
                    left.push(next);
                }
            }
        }
        piece.sort_unstable();
        found.push(piece);
    }
    found
}
