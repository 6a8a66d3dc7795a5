//! A SOG in a folder: its archive has checksums, which random changes do not pass.

use std::{fs, path::Path};

use omnilife_engine::gaussians::{ActivatedGaussians, static_gaussians};
use omnilife_reconstruct::formats::{exchange, splat::Placement};
use omnilife_schemas::records::InvalidGaussians;

use crate::{
    samples::unchanged,
    targets::{Reader::Folder, Target},
};

/// Readers of folders of Gaussians.
pub(crate) const SPLATS: &[Target] = &[Target {
    id: "sog",
    words: &[
        "\"bands\":",
        "\"files\":[",
        "null",
        "../",
        "1e308",
        "VP8L",
        "VP8X",
        "ANIM",
    ],
    cost: 1,
    seeds: write_sog,
    reader: Folder(|input, _| {
        drop(exchange::read(
            &input.folder.join("meta.json"),
            &Placement::WORLD,
            &unchanged(),
            &mut InvalidGaussians::default(),
        ));
    }),
}];

/// Gaussians with harmonics of degree 3.
const SOURCE: &[u8] = include_bytes!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/reconstruct/training/src/formats/exchange/peer/source.ply"
));

/// Writes the files of a SOG; names them.
fn write_sog(folder: &Path) -> Vec<String> {
    let mut invalid = InvalidGaussians::default();
    let source = Path::new("source.ply");
    let table = exchange::from_bytes(
        source,
        SOURCE,
        &Placement::WORLD,
        &unchanged(),
        &mut invalid,
    );
    let mut gaussians = ActivatedGaussians::default();
    static_gaussians::activate(&table.unwrap(), &mut gaussians);
    let archive = (exchange::by_name("sog").unwrap().write)(&gaussians).unwrap();
    // Files lie one behind the other, each with its name and size before it.
    let (mut rest, mut names) = (&archive[..], Vec::new());
    while rest.starts_with(b"PK\x03\x04") {
        let size = u32::from_le_bytes(rest[18..22].try_into().unwrap()) as usize;
        let name = u16::from_le_bytes(rest[26..28].try_into().unwrap());
        let (name, content) = rest[30..].split_at(usize::from(name));
        let name = String::from_utf8(name.to_vec()).unwrap();
        fs::write(folder.join(&name), &content[..size]).unwrap();
        names.push(name);
        rest = &content[size..];
    }
    names
}
