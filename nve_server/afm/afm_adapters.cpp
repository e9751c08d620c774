#include "telenano/nve_server/afm/afm_adapters.h"

#include <array>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/afm/nanonis_adapter.h"

namespace telenano::afm {
namespace {

struct Adapter {
  std::string_view name;
  std::unique_ptr<AfmPort> (*make)(const AfmConfig&);
};

constexpr std::array kAdapters = {Adapter{"nanonis", [](const AfmConfig& config) -> std::unique_ptr<AfmPort> {
                                            return std::make_unique<NanonisAdapter>(config);
                                          }}};

}  // namespace

std::vector<std::string> adapter_names() {
  std::vector<std::string> names;
  for (const Adapter& adapter : kAdapters) names.emplace_back(adapter.name);
  return names;
}

std::unique_ptr<AfmPort> make_adapter(std::string_view name, const AfmConfig& config) {
  std::string known;
  for (const Adapter& adapter : kAdapters) {
    if (adapter.name == name) return adapter.make(config);
    known += (known.empty() ? "" : ", ") + std::string(adapter.name);
  }
  throw UserError("--slave " + std::string(name) + ": unknown controller; known controllers: " + known);
}

}  // namespace telenano::afm
