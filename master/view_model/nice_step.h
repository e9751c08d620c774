#pragma once

namespace telenano::view_model {

/// The largest of 1, 2, 5 · 10^n that is at most `value`; 1 for what is not positive and finite.
double nice_step(double value) noexcept;

}  // namespace telenano::view_model
