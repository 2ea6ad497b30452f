//! Deep images as the exact functions of their pixels.
