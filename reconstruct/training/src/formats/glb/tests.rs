//! Attributes of the extension, in floats and integers, and refused files.

use super::*;
use crate::formats::exchange::tests::{activated, apart, varied};

const NAME: &str = "a.glb";

/// Returns the document and the binary part of a file.
fn taken_apart(bytes: &[u8]) -> (Value, Vec<u8>) {
    let (text, binary) = parts(bytes).expect("parts");
    (serde_json::from_slice(text).expect("JSON"), binary.to_vec())
}

/// Returns a file of a text and a binary part.
fn put_together(text: &str, binary: &[u8]) -> Vec<u8> {
    let word = |length: usize| (length as u32).to_le_bytes();
    let length = 28 + text.len() + binary.len();
    let head = [
        MAGIC,
        VERSION.to_le_bytes(),
        word(length),
        word(text.len()),
        JSON_CHUNK,
    ];
    let middle = [word(binary.len()), BINARY_CHUNK];
    [
        head.as_flattened(),
        text.as_bytes(),
        middle.as_flattened(),
        binary,
    ]
    .concat()
}

#[test]
fn floats_are_kept_to_the_bit() {
    for degree in 0..=3 {
        let written = varied(40, degree);
        let bytes = write(&written).expect("written");
        let read = activated(NAME, &bytes).expect("read");
        assert_eq!(read.positions, written.positions);
        assert_eq!(read.sh_constant, written.sh_constant);
        assert_eq!(read.sh_rest, written.sh_rest);
        let apart = apart(&written, &read);
        assert!(
            apart.degrees < 0.01 && apart.log_size < 1e-5 && apart.opacity < 1e-5,
            "{apart:?}"
        );
        assert_eq!(bytes.len() % 4, 0);
        assert_eq!(bytes[8..12], (bytes.len() as u32).to_le_bytes());
    }
}

#[test]
fn attributes_are_those_of_the_extension() {
    let mut gaussians = varied(3, 1);
    gaussians.positions = vec![[1.0, -2.0, 3.0], [0.0; 3], [-4.0, 5.0, 0.0]];
    let (document, binary) = taken_apart(&write(&gaussians).expect("written"));
    let at = |path: &str| document.pointer(path).cloned().unwrap_or_default();
    assert_eq!(at("/extensionsUsed/0"), EXTENSION);
    let primitive = at("/meshes/0/primitives/0");
    let attributes = primitive.get("attributes").and_then(Value::as_object);
    let mut names: Vec<&str> = attributes
        .iter()
        .flat_map(|all| all.keys())
        .map(String::as_str)
        .collect();
    names.sort_unstable();
    let expected = [
        "COLOR_0",
        "KHR_gaussian_splatting:OPACITY",
        "KHR_gaussian_splatting:ROTATION",
        "KHR_gaussian_splatting:SCALE",
        "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0",
        "KHR_gaussian_splatting:SH_DEGREE_1_COEF_0",
        "KHR_gaussian_splatting:SH_DEGREE_1_COEF_1",
        "KHR_gaussian_splatting:SH_DEGREE_1_COEF_2",
        "POSITION",
    ];
    assert_eq!(names, expected);
    // x to the left and y up.
    assert_eq!(at("/accessors/0/min"), json!([-1.0, -5.0, 0.0]));
    assert_eq!(at("/accessors/0/max"), json!([4.0, 2.0, 3.0]));
    let first: Vec<f32> = binary[..12]
        .as_chunks::<4>()
        .0
        .iter()
        .map(|&b| f32::from_le_bytes(b))
        .collect();
    assert_eq!(first, [-1.0, 2.0, 3.0]);
    assert_eq!(harmonic_name(3), named("SH_DEGREE_2_COEF_0"));
    assert_eq!(harmonic_name(14), named("SH_DEGREE_3_COEF_6"));
}

#[test]
fn normalized_integers_and_strides_are_read() {
    let attributes = "{\"POSITION\":0,\"KHR_gaussian_splatting:ROTATION\":1,\"KHR_gaussian_splatting:SCALE\":2,\
         \"KHR_gaussian_splatting:OPACITY\":3,\"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0\":0}";
    let accessor = |component: u64, kind: &str, view: usize| {
        format!(
            "{{\"bufferView\":{view},\"componentType\":{component},\"normalized\":true,\"count\":2,\"type\":\"{kind}\"}}"
        )
    };
    let accessors = [
        accessor(FLOAT, "VEC3", 0),
        accessor(SHORT, "VEC4", 1),
        accessor(BYTE, "VEC3", 2),
        accessor(UNSIGNED_BYTE, "SCALAR", 3),
    ];
    let text = format!(
        "{{\"meshes\":[{{\"primitives\":[{{\"mode\":0,\"attributes\":{attributes},\"extensions\":{{\
         \"KHR_gaussian_splatting\":{{\"kernel\":\"ellipse\",\"colorSpace\":\"srgb_rec709_display\"}}}}}}]}}],\
         \"accessors\":[{}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":28,\"byteStride\":16}},\
         {{\"buffer\":0,\"byteOffset\":28,\"byteLength\":16}},{{\"buffer\":0,\"byteOffset\":44,\"byteLength\":7,\
         \"byteStride\":4}},{{\"buffer\":0,\"byteOffset\":51,\"byteLength\":2}}],\"buffers\":[{{\"byteLength\":53}}]}}",
        accessors.join(",")
    );
    let mut binary = Vec::new();
    for value in [1.0_f32, 2.0, 3.0, 9.0, 0.5, 0.25, 0.125] {
        binary.extend(value.to_le_bytes());
    }
    for value in [0_i16, 0, 32_767, 0, -32_768, 0, 0, 0] {
        binary.extend(value.to_le_bytes());
    }
    binary.extend([127, 127, 127, 0, 127, 64, 127]);
    binary.extend([51, 255]);
    let read = activated(NAME, &put_together(&text, &binary)).expect("read");
    assert_eq!(read.positions, [[-1.0, -2.0, 3.0], [-0.5, -0.25, 0.125]]);
    assert_eq!(read.sh_constant[1], [0.5, 0.25, 0.125]);
    assert!(
        read.scales[0]
            .iter()
            .all(|scale| (scale - 1.0).abs() < 1e-6)
    );
    assert!((read.scales[1][1] - 64.0 / 127.0).abs() < 1e-6);
    assert!((read.opacities[0] - 0.2).abs() < 1e-6 && read.opacities[1] > 0.999);
    assert_eq!(read.rotations[0].map(f32::abs), [0.0, 0.0, 0.0, 1.0]);
}

/// Checks two nodes in a chain, one with a matrix.
#[test]
fn nodes_move_and_turn_their_gaussians() {
    let written = varied(5, 2);
    let (document, binary) = taken_apart(&write(&written).expect("written"));
    // A quarter rotation about z and twice as large; then along x.
    let nodes = "\"nodes\":[{\"children\":[1],\"translation\":[10,0,0]},\
         {\"mesh\":0,\"matrix\":[0,2,0,0,-2,0,0,0,0,0,2,0,0,0,1,1]}]";
    let text = document
        .to_string()
        .replace("\"nodes\":[{\"mesh\":0}]", nodes);
    assert!(text.contains("matrix"));
    let read = activated(NAME, &put_together(&text, &binary)).expect("read");
    let place = written.positions[0];
    // In axes of glTF (-x, -y, z) becomes (2 y + 10, -2 x, 2 z + 1), which is rotated back.
    let expected = [-2.0 * place[1] - 10.0, 2.0 * place[0], 2.0 * place[2] + 1.0];
    let found = read.positions[0];
    assert!(
        found
            .iter()
            .zip(expected)
            .all(|(a, b)| (a - b).abs() < 1e-4),
        "{found:?} {expected:?}"
    );
    assert!((read.scales[0][1] / written.scales[0][1] - 2.0).abs() < 1e-5);
    // About z the same rotation in both axes.
    let quarter = DQuat::from_xyzw(0.0, 0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt());
    let mut turned = written;
    for row in turned.sh_rest.chunks_exact_mut(8) {
        HarmonicTurn::new(quarter).apply(row);
    }
    for rotation in &mut turned.rotations {
        let [w, x, y, z] = rotation.map(f64::from);
        let DQuat { x, y, z, w } = quarter * DQuat::from_xyzw(x, y, z, w);
        *rotation = [w, x, y, z].map(|part| part as f32);
    }
    let apart = apart(&read, &turned);
    assert!(
        apart.degrees < 0.05 && apart.linear < 1e-5 && apart.rest < 1e-5,
        "{apart:?}"
    );
}

#[test]
fn what_is_no_glb_of_gaussians_is_refused_by_name() {
    let bytes = write(&varied(5, 1)).expect("written");
    let (document, binary) = taken_apart(&bytes);
    let text = document.to_string();
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        put_together(&text.replace(from, to), &binary)
    };
    let mut of_version_1 = bytes.clone();
    of_version_1[4] = 1;
    for (bytes, expected) in [
        (b"{\"asset\":{}}".to_vec(), "does not begin with glTF"),
        (of_version_1, "is a GLB of version 1, and 2 is read"),
        (bytes[..bytes.len() - 4].to_vec(), "is cut off"),
        (with("{", "["), "its JSON part"),
        (put_together("{}", &binary), "holds no Gaussians"),
        (
            with("\"ellipse\"", "\"disc\""),
            "of kernel \"disc\", and ellipse is read",
        ),
        (
            with("srgb_", "lin_"),
            "of colorSpace \"lin_rec709_display\"",
        ),
        (
            with("\"mesh\":0", "\"mesh\":0,\"scale\":[2,2,1]"),
            "only one positive scale",
        ),
        (
            with("\"mesh\":0", "\"mesh\":0,\"rotation\":[2,2]"),
            "is not 4 numbers",
        ),
        (with("\"mesh\":0", "\"mesh\":1"), "a mesh that is not there"),
        (
            with("\"mesh\":0", "\"mesh\":0,\"children\":[0]"),
            "children of themselves",
        ),
        (
            with("\"mesh\":0", "\"mesh\":0,\"children\":[1]"),
            "a child that is not there",
        ),
        (
            with(
                "\"mesh\":0",
                "\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,-1,0,0,0,0,1]",
            ),
            "shears or mirrors",
        ),
        (
            with("\"mode\":0", "\"mode\":4"),
            "must have Gaussians as points",
        ),
        (
            with(":OPACITY", ":OPAQUE"),
            "without KHR_gaussian_splatting:OPACITY",
        ),
        (
            with("\"POSITION\":0", "\"POSITION\":99"),
            "names 99 of its accessors",
        ),
        (
            with("\"count\":5", "\"count\":6"),
            "that its view does not hold",
        ),
        (with("\"bufferView\":2,", ""), "it is compressed"),
        (
            with("\"componentType\":5126", "\"componentType\":5125"),
            "components of type 5125",
        ),
        (
            with("\"byteOffset\":60", "\"byteOffset\":99999"),
            "a view ends behind the binary part",
        ),
        (
            with("\"byteOffset\":60", "\"byteOffset\":-1"),
            "has byteOffset -1, must be a size of 0 or more",
        ),
        (
            with("\"buffers\":[{", "\"buffers\":[{\"uri\":\"a.bin\","),
            "in another file",
        ),
        (
            with("SH_DEGREE_1_COEF_1", "SH_DEGREE_1_COEF_9"),
            "without KHR_gaussian_splatting:SH_DEGREE_1_COEF_1",
        ),
    ] {
        let message = activated(NAME, &bytes).map(drop);
        let message = message.err().unwrap_or_else(|| "taken".to_owned());
        assert!(message.contains(expected), "{message}, not {expected}");
    }
    // Sizes begin behind five places and rotations.
    let mut logarithms = binary.clone();
    logarithms[140..144].copy_from_slice(&(-3.0_f32).to_le_bytes());
    let message = activated(NAME, &put_together(&text, &logarithms))
        .map(drop)
        .expect_err("refused");
    assert!(
        message.contains("a negative size at Gaussian 0"),
        "{message}"
    );
}
