// Status of training steps, written by the device and read by the host. A step that cannot be taken halts the
// device: it and all later steps change nothing until the host has handled it.

const RUNNING: u32 = 0u;
// A view has more tile entries than the buffers hold.
const HALTED_FULL: u32 = 1u;
// The loss is not finite.
const HALTED_DIVERGED: u32 = 2u;

struct Status {
    halted: u32,
    // Steps taken since the host cleared the status.
    steps: u32,
    // Largest number of tile entries of a view.
    entries: u32,
    // Number of gradient values that were not finite, per array of the table.
    refused: array<atomic<u32>, 16>,
}
