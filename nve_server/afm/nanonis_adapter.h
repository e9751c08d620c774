#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "telenano/nve_server/afm/afm_config.h"
#include "telenano/nve_server/afm/afm_port.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::afm {

/// A controller that speaks the Nanonis TCP protocol: metres, volts by its own calibration of the signals, Z
/// limits, SafeTip as its own protection. The one place besides the guard that knows its commands.
class NanonisAdapter final : public AfmPort {
 public:
  explicit NanonisAdapter(const AfmConfig& config);

  std::unique_ptr<AfmPort> clone() const override { return std::make_unique<NanonisAdapter>(*this); }
  AfmCapabilities capabilities() const noexcept override { return {true, true}; }
  std::size_t setup_steps() const noexcept override { return steps_.size(); }
  Role setup_role(std::size_t step) const noexcept override { return steps_[step].role; }
  std::size_t give_back_steps() const noexcept override { return give_back_.size(); }
  Role give_back_role(std::size_t step) const noexcept override { return give_back_[step].role; }
  std::size_t held_settings() const noexcept override { return kHeld; }
  std::vector<std::uint8_t> encode(Role role, const AfmCommand& command) override;
  void feed(Role role, std::span<const std::uint8_t> bytes) override { line(role).reader.feed(bytes); }
  Next next(Role role, AfmReading& reading) override;
  void reset(Role role) override { line(role) = {}; }
  bool averages(const AfmCommand& command) const noexcept override;
  double signal_of(double deflection_nm) const noexcept override {
    return offset_ + calibration_m_v_ * deflection_nm / config_.sensitivity_nm_v;
  }

 private:
  struct Step {
    Role role;
    nanonis::Call call;
    bool keep = false;  ///< what it says is given back at the end
  };
  struct Line {
    nanonis::FrameReader reader;
    bool busy = false;
    AfmCommand command;
    nanonis::Call call;
  };
  static constexpr std::size_t kHeld = 6;
  std::string held(const nanonis::Call& call, const nanonis::Answer& answer) const;
  Line& line(Role role) noexcept { return lines_[static_cast<std::size_t>(role)]; }
  nanonis::Call call_of(const AfmCommand& command) const;
  nanonis::Call limits_call(double floor_nm) const;
  AfmReading reading_of(const nanonis::Call& call, const nanonis::Answer& answer) const;
  void keep(const Step& step, const nanonis::Answer& answer);
  std::string set_up(const Step& step, const nanonis::Answer& answer);
  void set_later(nanonis::CommandId id, const std::vector<double>& numbers);

  AfmConfig config_;
  std::array<Line, kRoles> lines_;
  std::vector<Step> steps_;
  std::vector<Step> give_back_;
  double calibration_m_v_ = 0;  // units of the signal a volt
  double offset_ = 0;
  double lateral_calibration_ = 1;
  double lateral_offset_ = 0;
  bool had_limits_ = false;
  double outer_high_m_ = 0, outer_low_m_ = 0;  // limits within which all happens
  bool threshold_known_ = false;
  double threshold_ = 0;    // of SafeTip
  bool in_metres_ = false;  // the deflection, by its name
};

}  // namespace telenano::afm
