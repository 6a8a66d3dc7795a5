//! Choice of the frames that one is compared with.

/// Maximum number of frames that one is compared with.
pub(super) const OTHERS: usize = 8;
/// Least interval between them, seconds; half of that from the frame itself.
const APART_SECONDS: f64 = 1.0;

/// Chooses the frames that others are compared with: [`APART_SECONDS`] apart.
pub(super) fn background_frames(seconds: &[f64]) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for (number, &time) in seconds.iter().enumerate() {
        // A little less than the interval: time stamps are rounded.
        if chosen
            .last()
            .is_none_or(|&last| time - seconds[last] >= APART_SECONDS - 0.01)
        {
            chosen.push(number);
        }
    }
    chosen
}

/// Returns the frames that one is compared with, the nearest first: every second of those of the background, on both
/// sides as long as there are any. A short clip has no choice.
pub(super) fn compared_with(index: usize, seconds: &[f64], background: &[usize]) -> Vec<usize> {
    let apart = |other: usize| (seconds[other] - seconds[index]).abs();
    let far = background
        .iter()
        .copied()
        .filter(|&other| apart(other) >= 0.5 * APART_SECONDS - 0.01);
    let (mut before, after): (Vec<usize>, Vec<usize>) = far.partition(|&other| other < index);
    before.reverse();
    let step = if before.len() + after.len() < 2 * OTHERS {
        1
    } else {
        2
    };
    let mut others: Vec<usize> = [&before, &after]
        .into_iter()
        .flat_map(|side| side.iter().copied().step_by(step))
        .collect();
    if others.is_empty() {
        others = (0..seconds.len()).filter(|&other| other != index).collect();
    }
    others.sort_by(|&a, &b| apart(a).total_cmp(&apart(b)));
    others.truncate(OTHERS);
    others
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_compared_with_others_seconds_apart() {
        let others = |index: usize, rate: f64, count: usize| {
            let seconds: Vec<f64> = (0..count).map(|n| n as f64 / rate).collect();
            let mut others = compared_with(index, &seconds, &background_frames(&seconds));
            others.sort_unstable();
            others
        };
        assert_eq!(others(15, 1.0, 31), [8, 10, 12, 14, 16, 18, 20, 22]);
        // Five times as many frames: the same seconds.
        let every_fifth = [40, 50, 60, 70, 80, 90, 100, 110];
        assert_eq!(others(75, 5.0, 151), every_fifth);
        assert_eq!(others(77, 5.0, 151).len(), OTHERS);
        assert_eq!(others(0, 1.0, 5), [1, 2, 3, 4]);
        assert_eq!(others(1, 1.0, 2), [0]);
        // No frame is far enough: all are used.
        assert_eq!(others(0, 10.0, 3), [1, 2]);
    }
}
