//! Packing against the store's own numbers.
