#include "telenano/nve_server/app/serve/serve_log.h"

#include <fmt/format.h>

#include <string>

#include "telenano/common/link/drop_cause.h"
#include "telenano/common/net/udp.h"

namespace telenano::app {
namespace {

/// How much may wait for the loop before the kernel drops it, whoever sent it.
std::string buffer_text(std::size_t granted) {
  std::string text = fmt::format("receive buffer {} KiB", granted / 1024);
  if (granted >= net::Udp::kBufferBytes) return text;
  return text + fmt::format(
                    " of the {} KiB asked for: bursts may be lost; raise the limit with sysctl -w "
                    "net.core.rmem_max={}",
                    net::Udp::kBufferBytes / 1024, net::Udp::kBufferBytes);
}

}  // namespace

void log_served(spdlog::logger& log, const ServeOptions& options, const Workers& workers,
                const std::vector<server::ServedScene>& scenes, bool one_tip) {
  log.info("serving {} on {}{}{}", names_of(options), net::to_string(workers.local()),
           options.security.is_secure() ? ", encrypted" : "", one_tip ? ", one tip for all" : "");
  for (const server::ServedScene& one : scenes) {
    if (one.to_fetch)
      log.info("stations may fetch the scene: {} bytes, {:016x}", one.to_fetch->offer.bytes,
               one.to_fetch->offer.name());
    else if (!one.why_no_fetch.empty())
      log.info("stations cannot fetch the scene: {}", one.why_no_fetch);
  }
  log.info("{}", buffer_text(workers.receive_buffer_bytes()));
}

void log_stopped(spdlog::logger& log, const Workers& workers, bool secure) {
  const server::ServerCounters counters = workers.counters();
  const link::DropCounters dropped = workers.drops();
  std::string drops;
  for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
    const auto cause = static_cast<link::DropCause>(i);
    if (dropped[cause] == 0) continue;
    drops +=
        std::string(drops.empty() ? "" : ", ") + link::name(cause) + " " + std::to_string(dropped[cause]);
  }
  log.info("stopped: {} exchanges in {} sessions ({} resumed); dropped: {}", counters.exchanges,
           counters.opened, counters.resumed, drops.empty() ? "none" : drops);
  if (counters.scene_chunks > 0) log.info("{} pieces of the scene were fetched", counters.scene_chunks);
  if (counters.deferred > 0 || counters.cut > 0)
    log.info("beyond their share of the server: {} commands waited for later ones, {} steps were cut",
             counters.deferred, counters.cut);
  if (counters.switched > 0) log.info("switches of a session to another scene: {}", counters.switched);
  if (counters.recovered > 0) log.info("{} lost commands were repeated in time", counters.recovered);
  if (secure) log.info("channels: {}", workers.channels_text());
  if (workers.refused_local_users() > 0)
    log.info("--local-users: {} datagrams of others", workers.refused_local_users());
}

}  // namespace telenano::app
