//! Chunks and words of the layout, and refused files.

use super::*;
use crate::formats::exchange::tests::{activated, apart, varied};

const NAME: &str = "a.compressed.ply";

#[test]
fn chunks_hold_256_gaussians_each_in_the_order_of_the_curve() {
    let gaussians = varied(600, 1);
    let bytes = write(&gaussians).expect("written");
    assert!(is_compressed(&bytes));
    let text = String::from_utf8_lossy(&bytes[..400]).into_owned();
    assert!(text.starts_with(
        "ply\nformat binary_little_endian 1.0\nelement chunk 3\nproperty float min_x\n"
    ));
    let body = bytes.len() - 600 * (16 + 9) - 3 * 72;
    assert!(bytes[..body].ends_with(b"end_header\n"));
    let read = activated(NAME, &bytes).expect("read");
    assert_eq!(read.len(), 600);
    let mut order: Vec<usize> = (0..600).collect();
    order.sort_by_key(|&index| morton_code(gaussians.positions[index]));
    for (found, index) in read.sh_constant.iter().zip(order) {
        let expected = gaussians.sh_constant[index];
        let is_near = found
            .iter()
            .zip(expected)
            .all(|(a, b)| (a - b).abs() < 0.01);
        assert!(is_near, "{found:?} {expected:?}");
    }
}

#[test]
fn one_gaussian_is_exact_but_for_rotation_opacity_and_harmonics() {
    let mut gaussians = varied(1, 2);
    gaussians.rotations[0] = [0.0, 0.0, -1.0, 0.0];
    let bytes = write(&gaussians).expect("written");
    let read = activated(NAME, &bytes).expect("read");
    assert_eq!(read.positions, gaussians.positions);
    let apart = apart(&read, &gaussians);
    assert!(
        apart.log_size < 1e-6 && apart.constant < 1e-5 && apart.degrees < 0.2,
        "{apart:?}"
    );
    assert!(
        apart.opacity < 0.002 && apart.linear < 0.0157 && apart.rest < 0.0157,
        "{apart:?}"
    );
}

#[test]
fn words_have_their_first_value_in_the_highest_bits() {
    assert_eq!(packed([1.0, 0.0, 0.0]), 0x7ff << 21);
    assert_eq!(packed([0.0, 1.0, 0.0]), 0x3ff << 11);
    assert_eq!(packed([0.0, 0.0, 1.0]), 0x7ff);
    assert_eq!(unpacked(packed([1.0, 0.0, 1.0])), [1.0, 0.0, 1.0]);
    assert_eq!(packed_rotation([0.0, -1.0, 0.0, 0.0]) >> 30, 1);
    for quaternion in [
        [1.0, 0.0, 0.0, 0.0],
        [0.5, -0.5, -0.5, 0.5],
        [0.1, 0.7, -0.7, 0.1],
    ] {
        let found = unpacked_rotation(packed_rotation(quaternion));
        let along: f32 = found.iter().zip(quaternion).map(|(a, b)| a * b).sum();
        assert!(along.abs() > 0.999, "{quaternion:?} {found:?}");
    }
}

#[test]
fn older_files_have_no_bounds_of_colours() {
    let mut gaussians = varied(1, 0);
    gaussians.sh_constant[0] = [0.0, 0.5 / SH_C0, -0.5 / SH_C0];
    let bytes = write(&gaussians).expect("written");
    let body = bytes.len() - 16 - 72;
    let header = String::from_utf8_lossy(&bytes[..body]).into_owned();
    let header = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"]
        .iter()
        .fold(header, |header, name| {
            header.replace(&format!("property float {name}\n"), "")
        });
    let mut old = header.into_bytes();
    old.extend(&bytes[body..body + 48]);
    old.extend(&bytes[body + 72..]);
    let at = old.len() - 4;
    old[at..].copy_from_slice(&0x80ff_00ff_u32.to_le_bytes());
    let mut invalid = InvalidGaussians::default();
    let table = read(Path::new(NAME), &old, &mut invalid).expect("read");
    let colour = table.row(4, 0).iter().map(|value| 0.5 + SH_C0 * value);
    let colour: Vec<u8> = colour.map(|value| (255.0 * value).round() as u8).collect();
    assert_eq!(colour, [0x80, 0xff, 0]);
}

#[test]
fn what_is_no_compressed_ply_is_refused_by_name() {
    let bytes = write(&varied(5, 1)).expect("written");
    let end = bytes
        .windows(11)
        .position(|window| window == b"end_header\n")
        .unwrap_or(0);
    let with = |from: &str, to: &str| {
        let header = String::from_utf8_lossy(&bytes[..end]).replace(from, to);
        [header.as_bytes(), &bytes[end..]].concat()
    };
    for (bytes, expected) in [
        (with("chunk 1", "chunk 2"), "has 2 chunks for 5 Gaussians"),
        (with("sh 5", "sh 6"), "chunks for 5 Gaussians"),
        (
            with("vertex 5", "vertex 99999999999999"),
            "chunks for 99999999999999 Gaussians",
        ),
        (
            with("vertex 5", "vertex many"),
            "its number of vertex is not a number",
        ),
        (
            with("element vertex", "element face"),
            "has an element face in place of vertex",
        ),
        (
            with("uint packed_scale", "float packed_scale"),
            "has other properties",
        ),
        (
            with("property uchar f_rest_8\n", ""),
            "has harmonics of no degree from 1 to 3",
        ),
        (
            with("binary_little", "binary_big"),
            "in binary_big_endian, which is not supported",
        ),
        (
            bytes[..bytes.len() - 1].to_vec(),
            "is cut off: 44 bytes are left for an array of 45",
        ),
        (bytes[..end].to_vec(), "is cut off in its header"),
    ] {
        let message = activated(NAME, &bytes).map(drop).expect_err("refused");
        assert!(message.contains(expected), "{message}, not {expected}");
    }
    let mut unbounded = bytes.clone();
    let at = end + 11;
    unbounded[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let message = activated(NAME, &unbounded).map(drop).expect_err("refused");
    assert!(
        message.contains("place of Gaussian 0 is not a finite number"),
        "{message}"
    );
}
