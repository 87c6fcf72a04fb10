//! Golden-image and end-to-end tests.
