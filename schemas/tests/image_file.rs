//! Images that state more pixels than they hold.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

use std::{fs, path::Path};

use omnilife_schemas::{RgbImage, image_file::ImageFile, rgb::Mask};

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 * (crc & 1))
        })
    })
}

/// A grey PNG file that states a size and holds next to nothing.
fn write_stating(path: &Path, width: u32, height: u32) {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[8, 0, 0, 0, 0],
    ]
    .concat();
    for (kind, data) in [(b"IHDR", header), (b"IDAT", vec![0; 32]), (b"IEND", vec![])] {
        bytes.extend((data.len() as u32).to_be_bytes());
        let body = [&kind[..], &data].concat();
        bytes.extend(&body);
        bytes.extend(crc32(&body).to_be_bytes());
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn sizes_are_looked_at_before_pixels() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("bomb.png");
    for (width, height) in [(23_000, 23_000), (u32::MAX >> 1, 1 << 20)] {
        write_stating(&path, width, height);
        for error in [
            RgbImage::read(&path).unwrap_err(),
            Mask::read(&path).unwrap_err(),
        ] {
            let message = error.to_string();
            assert!(
                message.contains("bomb.png") && !message.contains('\n'),
                "{message}"
            );
            assert!(
                message.contains(&format!("{width}x{height} pixels")) || width > 1 << 30,
                "{message}"
            );
        }
    }
    // A size that is allowed is told without its pixels, which are damaged.
    write_stating(&path, 4096, 2048);
    let file = ImageFile::open(&path).unwrap();
    assert_eq!(file.size(), [4096, 2048]);
    let error = file.expect_size([64, 32]).map(drop).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("is 4096x2048 pixels, expected 64x32"),
        "{error}"
    );
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(error.contains("not a usable image"), "{error}");
}

#[test]
fn depth_of_another_kind_is_refused_before_it_is_decoded() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("depth.png");
    write_stating(&path, 64, 32);
    let error = ImageFile::open(&path).unwrap().decode_grey16().unwrap_err();
    assert!(
        error.to_string().contains("expected 16-bit grey"),
        "{error}"
    );
}
