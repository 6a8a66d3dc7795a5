// What a device tells the host about the steps it was given. A step that cannot be taken halts the
// device: it and all steps after it change nothing, until the host has seen to it.

const RUNNING: u32 = 0u;
// A view has more tile entries than there is room for.
const HALTED_FULL: u32 = 1u;
// The loss is not finite.
const HALTED_DIVERGED: u32 = 2u;

struct Status {
    halted: u32,
    // Steps taken since the host cleared the status.
    steps: u32,
    // The most tile entries that a view had.
    entries: u32,
    // Gradient values that were not finite, by array of the table.
    refused: array<atomic<u32>, 16>,
}
