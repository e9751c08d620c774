#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "telenano/master/station/station.h"
#include "telenano/master/view_model/view_port.h"

namespace telenano::view_model {

/// The loop's side of a ViewPort: does what the screen asks for, once a tick, before it. Nothing waits,
/// allocates or throws.
class ViewRequestHandler {
 public:
  /// `impedance_bound`: of α_v α_F by method (ScalingRegion); a method is not taken where the scaling in use
  /// lies beyond its bound, nor a scaling beyond the bound of the method in use, unless the station's
  /// configuration allows it.
  ViewRequestHandler(ViewPort& port,
                     const std::array<double, control::kAllMethods.size()>& impedance_bound) noexcept
      : port_(port), impedance_bound_(impedance_bound), stops_(port.stops.load()) {}

  struct Asked {
    std::uint32_t buttons = 0;  ///< device::ButtonBits, to be or-ed to the device's in this tick
    bool quit = false;
    int marks = 0;
    bool undo = false;
    int task = -1;   ///< to begin; negative: none
    int scene = -1;  ///< to go to; likewise
    std::optional<link::PracticeLink> practice;
  };
  Asked answer(station::Station& station) noexcept;

  /// The next note, if there is one.
  bool take_note(Note& note) noexcept { return port_.notes.pop(note); }

  /// After the tick.
  void show(const recording::Sample& sample, device::ForceOffCause force_off) noexcept;

  void show(station::TwinState twin) noexcept { port_.twin.store(twin); }
  void show(const ShownContact& contact) noexcept { port_.contact.store(contact); }
  void show(const UndoShown& undo) noexcept { port_.undo.store(undo); }
  void show(const SceneShown& scene) noexcept { port_.scene.store(scene); }
  void show_chooser(bool link) noexcept { port_.method_by_link.store(link); }
  /// Of a hand that plays motions.
  void show(const device::TaskState& task) noexcept { port_.task.store(task); }

  std::uint64_t refused() const noexcept { return refused_; }

 private:
  bool safe(control::Method method, const control::Scaling& scaling,
            const station::Station& station) const noexcept;

  ViewPort& port_;
  std::array<double, control::kAllMethods.size()> impedance_bound_;
  std::uint64_t refused_ = 0;
  std::uint32_t stops_;  // heard of
};

}  // namespace telenano::view_model
