//! Bytes of the layout, those of the peer, and refused files.

use super::*;
use crate::formats::exchange::tests::{activated, apart, varied};

/// Returns the content of a file.
fn unzipped(bytes: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    let read = GzDecoder::new(bytes).read_to_end(&mut content);
    assert!(read.is_ok());
    content
}

fn zipped(content: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    let written = encoder.write_all(content);
    assert!(written.is_ok());
    encoder.finish().unwrap_or_default()
}

#[test]
fn arrays_are_those_of_the_layout() {
    let mut gaussians = varied(2, 1);
    gaussians.positions[0] = [1.0, -2.0, 0.5];
    gaussians.positions[1] = [0.0, 7.0, -3.0];
    gaussians.scales[0] = [1.0, (-10.0_f32).exp(), 100_f32.exp()];
    gaussians.rotations[0] = [1.0, 0.0, 0.0, 0.0];
    gaussians.opacities[0] = 0.2;
    gaussians.sh_constant[0] = [0.0, 100.0, -100.0];
    gaussians.sh_rest[0] = [0.0, 0.25, -1.0];
    let content = write_version_3(&gaussians)
        .map(|bytes| unzipped(&bytes))
        .unwrap_or_default();
    assert_eq!(content.len(), 16 + 2 * (9 + 1 + 3 + 3 + 4 + 9));
    // Seven units need 3 of 23 bits.
    assert_eq!(content[..16], *b"NGSP\x03\0\0\0\x02\0\0\0\x01\x14\0\0");
    let (up, back) = (2 << 20, -(1 << 19));
    let place: Vec<u8> = [1 << 20, up, back]
        .iter()
        .flat_map(|steps: &i32| steps.to_le_bytes()[..3].to_vec())
        .collect();
    assert_eq!(content[16..25], place);
    assert_eq!(content[34], 51);
    assert_eq!(content[36..39], [128, 255, 0]);
    assert_eq!(content[42..45], [160, 0, 255]);
    assert_eq!(content[48..52], [0, 0, 0, 0xc0]);
    // The harmonic of y changes its sign.
    assert_eq!(content[56..59], [128, 96, 255]);
}

#[test]
fn version_4_has_the_same_arrays_in_streams_of_their_own() {
    for degree in [0, 2] {
        let gaussians = varied(40, degree);
        let content = write_version_3(&gaussians)
            .map(|bytes| unzipped(&bytes))
            .unwrap_or_default();
        let bytes = write(&gaussians).unwrap_or_default();
        let streams = if degree == 0 { 5 } else { 6 };
        assert_eq!(bytes[..8], *b"NGSP\x04\0\0\0");
        assert_eq!(bytes[8..15], content[8..15]);
        assert_eq!(bytes[15], streams);
        assert_eq!(bytes[16..20], 32_u32.to_le_bytes());
        assert_eq!(bytes[20..32], [0; 12]);
        let (mut at, mut plain) = (32 + 16 * usize::from(streams), 16);
        for entry in bytes[32..at].as_chunks::<8>().0.as_chunks::<2>().0 {
            let [size, plain_size] = entry.map(|word| u64::from_le_bytes(word) as usize);
            let stream = zstd::decode_all(&bytes[at..at + size]).unwrap_or_default();
            assert_eq!(stream, content[plain..plain + plain_size]);
            (at, plain) = (at + size, plain + plain_size);
        }
        assert_eq!((at, plain), (bytes.len(), content.len()));
    }
}

#[test]
fn rotations_keep_a_fifth_of_a_degree_at_their_poles() {
    for quaternion in [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, -1.0],
        [0.5, -0.5, 0.5, -0.5],
        [FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2, 0.0],
        [-0.1, 0.7, 0.7, 0.1],
    ] {
        let found = unpacked(packed(quaternion));
        let length: f32 = quaternion
            .iter()
            .map(|part| part * part)
            .sum::<f32>()
            .sqrt();
        let along: f32 = found
            .iter()
            .zip(quaternion)
            .map(|(a, b)| a * b / length)
            .sum();
        let squares = found.iter().zip(quaternion);
        let squares = squares.map(|(a, b)| (a - along.signum() * b / length).powi(2));
        assert!(
            squares.sum::<f32>().sqrt() < 0.002,
            "{quaternion:?} {found:?}"
        );
    }
}

#[test]
fn version_2_is_read() {
    let written = varied(50, 2);
    let content = write_version_3(&written)
        .map(|bytes| unzipped(&bytes))
        .unwrap_or_default();
    let rotations = 16 + 50 * 16;
    let mut of_two = content[..rotations].to_vec();
    of_two[4] = 2;
    for rotation in &written.rotations {
        let [w, x, y, z] = HalfTurn::ABOUT_X.rotation(*rotation);
        of_two.extend([x, y, z].map(|part| byte(127.5 * part * w.signum() + 127.5)));
    }
    of_two.extend(&content[rotations + 50 * 4..]);
    let read = activated("a.spz", &zipped(&of_two)).expect("read");
    let apart = apart(&written, &read);
    // Where w is small, three bytes hold it inaccurately.
    assert!(apart.degrees < 12.0 && apart.linear < 0.0325, "{apart:?}");
}

#[test]
fn training_with_anti_aliasing_is_told_from_that_without() {
    let gaussians = varied(5, 1);
    let versions = [write(&gaussians), write_version_3(&gaussians)].map(Result::unwrap_or_default);
    for (mut bytes, is_plain) in versions.into_iter().zip([true, false]) {
        for flag in [0, IS_ANTIALIASED] {
            if is_plain {
                bytes[14] = flag;
            } else {
                let mut content = unzipped(&bytes);
                content[14] = flag;
                bytes = zipped(&content);
            }
            let mut invalid = InvalidGaussians::default();
            let table = read(Path::new("a.spz"), &bytes, &mut invalid);
            assert!(table.is_ok_and(|table| table.len() == 5));
            assert_eq!(invalid.is_antialiased, flag == IS_ANTIALIASED);
        }
    }
}

#[test]
fn what_is_no_spz_is_refused_by_name() {
    let content = write_version_3(&varied(5, 1))
        .map(|bytes| unzipped(&bytes))
        .unwrap_or_default();
    let with = |at: usize, values: &[u8]| {
        let mut content = content.clone();
        content[at..at + values.len()].copy_from_slice(values);
        zipped(&content)
    };
    for (bytes, expected) in [
        (b"PK\x03\x04".to_vec(), "cannot be decompressed"),
        (with(0, b"X"), "does not begin with NGSP"),
        (with(4, &[1]), "version 1, and 2 to 4 are read"),
        (with(4, &[4]), "in the container of another"),
        (with(8, &[6]), "is cut off: an array of 54 bytes has"),
        (with(8, &[4]), "goes on behind its Gaussians"),
        (with(8, &[0, 0]), "holds no Gaussians"),
        (with(12, &[4]), "degree 4"),
        (with(13, &[99]), "99 fractional bits"),
        (with(14, &[2]), "extensions"),
        (content.clone(), "in the container of another"),
    ] {
        let message = activated("a.spz", &bytes).map(drop).expect_err("refused");
        assert!(message.contains(expected), "{message}, not {expected}");
    }
    let message = activated("a.spz", &with(8, &[255; 4]))
        .map(drop)
        .expect_err("refused");
    assert!(!message.contains('\n'), "{message}");
}

#[test]
fn scenes_that_reach_too_far_are_refused() {
    let mut gaussians = varied(2, 0);
    gaussians.positions[1][2] = 9e6;
    let message = write(&gaussians).map(drop).expect_err("refused");
    assert!(message.contains("reaches 9000000 units"), "{message}");
    gaussians.positions[1][2] = 8e6;
    assert!(write(&gaussians).is_ok());
}
