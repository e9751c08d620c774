#include "telenano/master/device/omega/sdk.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

namespace fs = std::filesystem;

constexpr const char* kAdvice =
    "install the SDK from forcedimension.com and set FDSDK to the folder where it was unpacked";

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value != nullptr ? value : "";
}

/// Libraries of that name in a folder, the highest version first.
std::vector<std::string> libraries_in(const fs::path& folder, const std::string& name) {
  std::vector<std::string> found;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string file = it->path().filename().string();
    if (file.starts_with(name + ".so")) found.push_back(it->path().string());
  }
  std::sort(found.rbegin(), found.rend());
  return found;
}

std::vector<std::string> candidates(const SdkSearch& search) {
  std::vector<std::string> list;
  std::vector<fs::path> folders;
  if (!search.fdsdk.empty()) folders.push_back(fs::path(search.fdsdk) / "lib/release/lin-x86_64-gcc");
  if (!search.home.empty()) folders.push_back(fs::path(search.home) / ".local/lib");
  for (const auto& folder : folders) {
    for (const char* name : {"libdrd", "libdhd"}) {
      for (auto& file : libraries_in(folder, name)) list.push_back(std::move(file));
    }
  }
  list.insert(list.end(), search.loader_names.begin(), search.loader_names.end());
  return list;
}

std::string folders_text(const SdkSearch& search) {
  return (search.fdsdk.empty() ? std::string("FDSDK is not set") : "FDSDK=" + search.fdsdk) +
         ", ~/.local/lib and the loader's path hold neither libdrd.so nor libdhd.so";
}

/// POSIX lets dlsym's result be turned into a function pointer.
template <class Function>
bool resolve(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  return function != nullptr;
}

/// The names that are missing, separated by commas.
std::string resolve_all(void* library, Sdk& sdk) {
  std::string missing;
  const auto need = [&](const char* name, auto& function) {
    if (!resolve(library, name, function)) missing += (missing.empty() ? "" : ", ") + std::string(name);
  };
#define TELENANO_NEED(name) need(#name, sdk.name)
  TELENANO_NEED(dhdGetDeviceCount);
  TELENANO_NEED(dhdOpenID);
  TELENANO_NEED(dhdClose);
  TELENANO_NEED(dhdStop);
  TELENANO_NEED(dhdGetSystemType);
  TELENANO_NEED(dhdGetSystemName);
  TELENANO_NEED(dhdGetSerialNumber);
  TELENANO_NEED(dhdGetSDKVersion);
  TELENANO_NEED(dhdGetPosition);
  TELENANO_NEED(dhdSetForce);
  TELENANO_NEED(dhdGetForce);
  TELENANO_NEED(dhdEnableForce);
  TELENANO_NEED(dhdSetGravityCompensation);
  TELENANO_NEED(dhdGetMaxForce);
  TELENANO_NEED(dhdGetButtonMask);
  TELENANO_NEED(dhdGetStatus);
  TELENANO_NEED(dhdErrorGetLastStr);
  TELENANO_NEED(dhdSetWatchdog);
#undef TELENANO_NEED
  const bool drd =
      resolve(library, "drdOpenID", sdk.drdOpenID) && resolve(library, "drdClose", sdk.drdClose) &&
      resolve(library, "drdIsInitialized", sdk.drdIsInitialized) &&
      resolve(library, "drdStop", sdk.drdStop) && resolve(library, "drdAutoInit", sdk.drdAutoInit);
  if (!drd) sdk.drdAutoInit = nullptr;
  return missing;
}

}  // namespace

SdkSearch SdkSearch::of_this_machine() {
  SdkSearch search;
  search.fdsdk = environment("FDSDK");
  search.home = environment("HOME");
  return search;
}

Sdk load_sdk(const SdkSearch& search) {
  for (const std::string& candidate : candidates(search)) {
    const bool is_file = candidate.find('/') != std::string::npos;
    void* const library = ::dlopen(candidate.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
      const char* const reason = ::dlerror();
      if (!is_file) continue;  // the loader does not know it: that is no error of a file
      throw UserError("Force Dimension SDK: " + candidate +
                      " cannot be loaded: " + (reason != nullptr ? reason : "no reason given") +
                      "; install what it needs (libusb-1.0-0) or the SDK for this machine");
    }
    Sdk sdk;
    sdk.path = candidate;
    const std::string missing = resolve_all(library, sdk);
    if (!missing.empty()) {
      ::dlclose(library);
      throw UserError("Force Dimension SDK: " + candidate + " has no " + missing +
                      "; it is too old or no such library: install SDK 3.10 or newer");
    }
    int version[4] = {};
    sdk.dhdGetSDKVersion(&version[0], &version[1], &version[2], &version[3]);
    sdk.version = std::to_string(version[0]) + "." + std::to_string(version[1]) + "." +
                  std::to_string(version[2]) + "." + std::to_string(version[3]);
    return sdk;
  }
  throw UserError("Force Dimension SDK not found: " + folders_text(search) + "; " + kAdvice);
}

}  // namespace telenano::device
