#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/studies/precision/studies.h"

namespace telenano::studies {
namespace {

struct Format {
  std::string family;
  std::string setting;
  bool is_default;
  std::function<double(double)> sent;  ///< what arrives of a number of nm
};

std::vector<Format> formats() {
  return {
      {"double", "8 bytes", true, [](double x) { return x; }},
      {"float", "4 bytes", false, [](double x) { return static_cast<double>(static_cast<float>(x)); }},
      {"32-bit integer", "4 bytes, of 1 pm", false, [](double x) { return std::nearbyint(x * 1e3) * 1e-3; }}};
}

}  // namespace

Section wire_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "wire";
  section.title = "Number format on the wire";
  section.lead =
      "A position that is rounded on its way to the server, at three distances from the origin of the scan: "
      "error of the force of a stiff contact (silicon oxide, 20 nm tip, rigid probe, about 1 nm deep) in nN. "
      "The rounding itself is known: half a unit in the last place, 2⁻²⁵ of the position for a float.";
  section.choice =
      "Default: double. At 100 µm from the origin a float resolves 8 pm, which a stiff contact turns into "
      "nanonewtons of chatter at every step; the doubles of a command cost 32 bytes more than floats, 2.6 µs "
      "at 100 Mbit/s, and no time in the codec. A 32-bit integer of 1 pm would do over 2 mm, but would write "
      "one controller's range into the protocol.";
  const double e_star = 1 / ((1 - 0.27 * 0.27) / 160 + (1 - 0.27 * 0.27) / 70);
  physics::TipSampleParameters parameters;
  parameters.contact_modulus_gpa = 4.0 / 3.0 * e_star;
  parameters.work_of_adhesion_n_m = 0.4;
  const physics::TipSampleLaw law(parameters);
  const int count = effort.pick(200, 2000);
  for (const double origin : {1e2, 1e4, 1e5}) {
    for (const Format& format : formats()) {
      Random random(7);
      physics::TipSampleState state;
      law.advance(1.0, 0.0, 20, state);
      std::vector<double> errors;
      for (int i = 0; i < count; ++i) {
        const double overlap = random.uniform(0.5, 1.5);
        const double received = format.sent(origin + overlap) - origin;
        // (origin + overlap) − origin: its own rounding in double is 1e-11 nm at most, far below the others.
        physics::TipSampleState a = state;
        physics::TipSampleState b = state;
        errors.push_back(std::fabs(law.advance(received, 0.0, 20, a).force_nn -
                                   law.advance(overlap, 0.0, 20, b).force_nn));
      }
      double sink = 0;
      const Cost cost = measure(
          [&] {
            for (int i = 0; i < 1000; ++i) sink += format.sent(origin + 1e-3 * i);
          },
          1000, effort);
      if (!std::isfinite(sink)) throw std::logic_error("wire: not finite");
      section.rows.push_back({fmt::format("{:g} µm from the origin", origin * 1e-3), format.family,
                              format.setting, format.is_default, summarise(errors), cost});
    }
  }
  (void)folder;
  return section;
}

}  // namespace telenano::studies
