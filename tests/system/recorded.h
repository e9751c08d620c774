#pragma once

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/system/programs.h"

/// What a station records while it runs: a test waits for what happens rather than for a time.
namespace telenano::programs {

inline constexpr double kContact = 3;  // link::ContactState
inline constexpr double kEngaged = 2;  // station::Mode

/// Reads a recording under its writer's hands until it is as wanted.
template <class Wanted>
::testing::AssertionResult wait_for(ChildProcess& station, const std::string& file, Wanted&& wanted) {
  const auto end = std::chrono::steady_clock::now() + kLong;
  while (std::chrono::steady_clock::now() < end) {
    if (!station.running())
      return ::testing::AssertionFailure() << "the station ended early: " << station.err();
    try {
      if (wanted(recording::RecordingReader(file))) return ::testing::AssertionSuccess();
    } catch (const UserError&) {
      // Not there yet, or between two states: look again.
    }
    std::this_thread::sleep_for(Milliseconds(20));
  }
  return ::testing::AssertionFailure();
}

/// Until in `rows` of its last rows an engaged station was in contact. (What is held shows the last reply.)
inline ::testing::AssertionResult wait_for_contact(ChildProcess& station, const std::string& file,
                                                   std::size_t rows = 50) {
  return wait_for(station, file,
                  [&](const recording::RecordingReader& reader) {
                    const std::vector<double> contact = reader.read("contact_state");
                    const std::vector<double> mode = reader.read("station_mode");
                    const std::size_t size = std::min(contact.size(), mode.size());
                    std::size_t n = 0;
                    while (n < size && contact[size - 1 - n] == kContact && mode[size - 1 - n] == kEngaged)
                      ++n;
                    return n >= rows;
                  })
         << "never in contact";
}

inline bool has_event(const recording::RecordingReader& reader, const std::string& text) {
  const auto events = reader.events();
  return std::any_of(events.begin(), events.end(),
                     [&](const recording::Event& event) { return text == event.text.data(); });
}

/// Until this event is in it.
inline ::testing::AssertionResult wait_for_event(ChildProcess& station, const std::string& file,
                                                 const std::string& text) {
  return wait_for(station, file,
                  [&](const recording::RecordingReader& reader) { return has_event(reader, text); })
         << "never: " << text;
}

}  // namespace telenano::programs
