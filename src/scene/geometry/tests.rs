//! Walls and luminaires against closed forms and slow twins.
