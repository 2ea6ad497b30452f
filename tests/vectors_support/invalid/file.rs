//! Header, trailer, and the positions of the parts.

use super::*;

pub fn add(add: &mut Add<'_>) {
    let small = small();
    add("HEADER-MAGIC", small.clone().put(0, &[0x09]).signed());
    // A transfer that makes CR LF to LF, in the magic alone.
    let translated = small.clone().put(4, &[0x0A, 0x1A, 0x0A, 0]);
    add("HEADER-MAGIC-line-ends", translated.signed());
    add("HEADER-MAGIC-short", b"solid teapot\n".to_vec());
    add("HEADER-SIZE", small.clone().put(10, &[128]).signed());
    add("HEADER-RESERVED", small.clone().put(59, &[1]).signed());
    add("HEADER-CRC", small.clone().put(60, &[small.0[60] ^ 1]).0);
    add("unsupported-version", small.clone().put(8, &[2]).signed());
    let damaged = small.clone().put(8, &[2, 0, 77]).0;
    add("unsupported-version-damaged", damaged);

    add("FILE-SHORT", small.0[..100].to_vec());
    add("FILE-SHORT-empty", Vec::new());
    let t = small.trailer();
    add("FILE-LENGTH", small.clone().plus(t, 8).signed());
    add("FILE-LENGTH-longer", small.clone().plus(t, -8).signed());
    add("TRAILER-VERSION", small.clone().put(t + 36, &[2]).signed());
    add("TRAILER-RESERVED", small.clone().put(t + 51, &[1]).signed());
    add(
        "TRAILER-COMMIT",
        small.clone().put(t + 59, &[0x0D]).signed(),
    );
    add("TRAILER-COMMIT-cut-off", small.0[..t].to_vec());
    let crc = [small.0[t + 60] ^ 1];
    add("TRAILER-CRC", small.clone().put(t + 60, &crc).0);

    // The directory begins before the tiles, off the grid, and after the footer.
    let lit = lit();
    let directory = |at: u64| {
        let t = lit.trailer();
        lit.clone().put(t + 8, &at.to_le_bytes()).signed()
    };
    add("DIRECTORY-RANGE", directory(56));
    add("DIRECTORY-RANGE-unaligned", directory(65));
    let behind = lit.footer() as u64 + 8;
    add("DIRECTORY-RANGE-behind-footer", directory(behind));

    add("FOOTER-RANGE", small.clone().insert(t, &[0; 8]).signed());
    let footer = small.footer();
    let moved = small.clone().insert(footer, &[0; 4]);
    add("FOOTER-RANGE-unaligned", moved.signed());
    let odd = small.clone().records(|f| f.truncate(f.len() - 4));
    add("FOOTER-RANGE-odd-size", odd.signed());
    let size = |size: u64| small.clone().put(t + 24, &size.to_le_bytes());
    add("FOOTER-RANGE-huge", size(u64::MAX - 7).sign_trailer());
    // The sum of offset and size is right modulo 2^64.
    let wrapped = size(t as u64 + 8).put(t + 16, &(u64::MAX - 7).to_le_bytes());
    add("FOOTER-RANGE-overflow", wrapped.sign_trailer());
    let crc = [small.0[t + 32] ^ 1];
    add("FOOTER-CRC", small.clone().put(t + 32, &crc).sign_trailer());
}
