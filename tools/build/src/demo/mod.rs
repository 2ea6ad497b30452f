//! Objects that need no file: made from a few numbers and a seed, the same on every machine.
