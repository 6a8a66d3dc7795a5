// Rows that go through a network together.
struct BlockRows {
    // Index of the first row.
    first: u32,
    rows: u32,
    // Number of parts into which a sum over the rows is divided.
    parts: u32,
}
