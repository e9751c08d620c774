#pragma once

namespace telenano {

extern const char* const kVersion;    ///< of the project, e.g. "0.1.0"
extern const char* const kGitCommit;  ///< of the source tree when it was built, "unknown" outside a checkout

}  // namespace telenano
