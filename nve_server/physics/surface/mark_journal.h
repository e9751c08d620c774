#pragma once

#include "telenano/nve_server/physics/surface/mark.h"

namespace telenano::physics {

/// Hears of every mark that a sample gets, in their order: who presses them into a copy of the surface as it
/// was when it began to listen has the same surface, bit for bit. Called within a step: no wait, no
/// allocation.
class MarkJournal {
 public:
  virtual ~MarkJournal() = default;
  virtual void on_mark(const Mark& mark) noexcept = 0;
  /// A stroke begins with the next mark.
  virtual void on_stroke() noexcept {}
  /// The last stroke that was not taken back yet is, of marks since this one listens or of others.
  virtual void on_undo() noexcept {}
};

}  // namespace telenano::physics
