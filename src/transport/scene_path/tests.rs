//! Scenes against closed forms and against each other.
