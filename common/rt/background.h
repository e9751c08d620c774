#pragma once

#include <vector>

namespace telenano::rt {

/// The calling thread, and those that it starts from now on, give way to all others of this user (nice 10):
/// for drawing, whose software renderer takes every processor that it can get. Never fails.
void enter_background() noexcept;
/// Other threads of this process likewise, by the numbers that threads_now() gives.
void enter_background(const std::vector<int>& threads) noexcept;

/// Linux's numbers of the threads that this process has now; none where they cannot be read. May throw
/// std::bad_alloc.
std::vector<int> threads_now();

}  // namespace telenano::rt
