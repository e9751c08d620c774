#pragma once

namespace telenano::rt {

/// The calling thread, and those that it starts from now on, give way to all others of this user (nice 10):
/// for drawing, whose software renderer takes every processor that it can get. Never fails.
void enter_background() noexcept;

}  // namespace telenano::rt
