//! The encoder against an independent decoder.

mod blocks;
mod damage;
mod files;
mod hints;
mod support;
