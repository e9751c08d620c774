#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "telenano/common/control/method.h"
#include "telenano/common/control/scaling.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/practice_link.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/rt/latest_value.h"
#include "telenano/common/rt/spsc_queue.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/played_motion.h"
#include "telenano/master/station/twin_run.h"

namespace telenano::view_model {

/// What a person at the screen asks of the loop.
struct ViewRequest {
  enum class Kind : std::uint8_t {
    kClearStop,  ///< a person has looked
    kMethod,     ///< bumpless
    kScaling,    ///< bumpless; not taken where it would not be safe
    kMarker,     ///< a mark in the recording
    kTask,       ///< of a simulated hand: lets go, goes back, begins
    kUndo,       ///< the last stroke of marks
    kPractice,   ///< another link to practise on
    kScene,      ///< another sample of the server, within the session
  };
  Kind kind = Kind::kClearStop;
  control::Method method = control::Method::kNone;
  control::Scaling scaling{};
  int task = 0;
  int scene = 0;  ///< its place in the server's list
  link::PracticeLink practice{};
};

/// What the tip has of the sample where it is.
struct ShownContact {
  double radius_nm = 0;    ///< of the contact; 0: none, or not known
  double adhesion_nn = 0;  ///< pull at which it lets go; 0: not known
  bool area_known = false;
};

enum class UndoText : std::uint8_t { kNone, kAsked, kDone, kRefused, kNoAnswer, kAnothers };
struct UndoShown {
  UndoText text = UndoText::kNone;
  std::uint32_t count = 0;  ///< another number: something new
};

enum class SceneText : std::uint8_t { kNone, kLetsGo, kAsked, kRefused, kNoAnswer, kRate, kShuttingDown };
struct SceneShown {
  SceneText text = SceneText::kNone;
  std::uint32_t count = 0;  ///< likewise
};

/// What a person writes into the recording, about the moment when writing began.
struct Note {
  static constexpr std::size_t kText = 58;  ///< an event's text less "note: ", with a zero at its end
  std::int64_t tick = 0;
  double time_s = 0;
  std::array<char, kText> text{};
};

/// Between the loop and the screen. Neither side ever waits: what finds a queue full is dropped and counted.
struct ViewPort {
  // From the loop.
  rt::SpscQueue<recording::Sample> samples{8192};    ///< two seconds at 4 kHz
  rt::LatestValue<device::ForceOffCause> force_off;  ///< why the device shows no force
  rt::LatestValue<device::TaskState> task;           ///< of a hand that plays motions
  rt::LatestValue<station::TwinState> twin;          ///< of the server's slave at the station
  rt::LatestValue<ShownContact> contact;
  rt::LatestValue<UndoShown> undo;       ///< what became of the last wish to take marks back
  rt::LatestValue<SceneShown> scene;     ///< what became of the last wish for another sample
  rt::LatestValue<bool> method_by_link;  ///< the method follows the link: nobody has said which
  // To the loop. What no queue may be too full for stands beside it: a loop that stood still for a while hears of a STOP
  // whatever else was asked of it meanwhile.
  std::atomic<std::uint32_t> stops{0};  ///< STOP was pressed so often; latched
  std::atomic<bool> quit{false};        ///< the session shall end; never taken back
  rt::SpscQueue<ViewRequest> requests{64};
  rt::SpscQueue<Note> notes{8};
  rt::LatestValue<std::uint32_t> buttons;  ///< device::ButtonBits held on the screen, or-ed to the device's
};

}  // namespace telenano::view_model
