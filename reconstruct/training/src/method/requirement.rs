//! Inputs that a method needs beside posed frames and a split.

/// An input that a method needs beside posed frames and a split. A method's row lists them, and
/// every command that runs methods walks the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Requirement {
    /// A camera that moves, so that places in space follow from its views. Nothing makes it: a scene
    /// has it or is refused.
    Parallax,
    /// Points of perspective scenes that are dense enough to tell what moves from what stands.
    DensePoints,
    /// Tracks of vehicles beside the split.
    Tracks,
}

impl Requirement {
    /// Noun for messages and lists.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parallax => "a camera that moves",
            Self::DensePoints => "dense points of perspective scenes",
            Self::Tracks => "tracks of vehicles",
        }
    }
}
