#pragma once

#include <string>

namespace telenano::studies::stress {

/// The same session in virtual time and in real time: server and station in threads of this process, over UDP
/// and the relay, at round trips of 0, 20 and 100 ms. CSV on standard output; 1 where they differ by more
/// than what is stated there, else 0.
int check_realtime(const std::string& scene_folder);

}  // namespace telenano::studies::stress
