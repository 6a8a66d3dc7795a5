// Rows that go through a network together.
struct BlockRows {
    // The number of the first.
    first: u32,
    rows: u32,
    // Into how many parts a sum over the rows is dealt out.
    parts: u32,
}
