//! Connected regions of a mask, and their confirmation by other evidence.

/// Returns the pixels of every connected region of marks in rows of `width`. In a panorama, which `wraps`, regions go on
/// across the seam.
pub(super) fn regions(marks: &[bool], width: usize, wraps: bool) -> Vec<Vec<usize>> {
    let height = marks.len() / width.max(1);
    let mut seen = vec![false; marks.len()];
    let mut found = Vec::new();
    for start in 0..marks.len() {
        if seen[start] || !marks[start] {
            continue;
        }
        seen[start] = true;
        let (mut pixels, mut open) = (Vec::new(), vec![start]);
        while let Some(at) = open.pop() {
            pixels.push(at);
            for next in neighbours(at, [width, height], wraps).into_iter().flatten() {
                if marks[next] && !seen[next] {
                    seen[next] = true;
                    open.push(next);
                }
            }
        }
        found.push(pixels);
    }
    found
}

/// Returns the neighbours of a pixel along its row and column.
fn neighbours(at: usize, [width, height]: [usize; 2], wraps: bool) -> [Option<usize>; 4] {
    let (x, y) = (at % width, at / width);
    let row = y * width;
    [
        (x + 1 < width || wraps).then(|| row + (x + 1) % width),
        (x > 0 || wraps).then(|| row + (x + width - 1) % width),
        (y + 1 < height).then_some(at + width),
        (y > 0).then(|| at - width),
    ]
}

/// Returns the share of a region's area that marks confirm, 0 to 1; `area` is that of a pixel in a row.
pub(super) fn confirmed_share(
    region: &[usize],
    marks: &[u8],
    width: usize,
    area: impl Fn(usize) -> f64,
) -> f64 {
    let (mut confirmed, mut all) = (0.0, 0.0);
    for &pixel in region {
        let area = area(pixel / width);
        all += area;
        if marks[pixel] != 0 {
            confirmed += area;
        }
    }
    if all > 0.0 { confirmed / all } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marks(rows: [&str; 3]) -> Vec<bool> {
        let all = rows.concat();
        all.bytes().map(|byte| byte == b'#').collect()
    }

    #[test]
    fn regions_go_on_across_the_seam_of_panoramas_alone() {
        let marks = marks(["#..#..", ".....#", "#....#"]);
        let sizes = |wraps| {
            let mut sizes: Vec<usize> = regions(&marks, 6, wraps).iter().map(Vec::len).collect();
            sizes.sort_unstable();
            sizes
        };
        assert_eq!(sizes(false), [1, 1, 1, 2]);
        assert_eq!(sizes(true), [1, 1, 3]);
    }

    #[test]
    fn confirmation_is_a_share_of_the_area() {
        let marked = [255, 0, 0, 0, 0, 0];
        let area = |row: usize| if row == 0 { 3.0 } else { 1.0 };
        assert_eq!(confirmed_share(&[0, 3], &marked, 3, area), 0.75);
        assert_eq!(confirmed_share(&[], &marked, 3, area), 0.0);
    }
}
