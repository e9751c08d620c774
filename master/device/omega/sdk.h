#pragma once

#include <string>
#include <vector>

namespace telenano::device {

/// The Force Dimension SDK as far as it is used, by its own names and signatures. Nothing of it is bundled
/// nor linked: the vendor's library is looked for when a person asks for the device.
struct Sdk {
  int (*dhdGetDeviceCount)() = nullptr;
  int (*dhdOpenID)(char id) = nullptr;
  int (*dhdClose)(char id) = nullptr;
  int (*dhdStop)(char id) = nullptr;
  int (*dhdGetSystemType)(char id) = nullptr;
  const char* (*dhdGetSystemName)(char id) = nullptr;
  int (*dhdGetSerialNumber)(unsigned short* serial, char id) = nullptr;
  void (*dhdGetSDKVersion)(int* major, int* minor, int* release, int* revision) = nullptr;
  int (*dhdGetPosition)(double* x, double* y, double* z, char id) = nullptr;
  int (*dhdSetForce)(double x, double y, double z, char id) = nullptr;
  int (*dhdGetForce)(double* x, double* y, double* z, char id) = nullptr;
  int (*dhdEnableForce)(unsigned char on, char id) = nullptr;
  int (*dhdSetGravityCompensation)(int on, char id) = nullptr;
  double (*dhdGetMaxForce)(char id) = nullptr;
  unsigned int (*dhdGetButtonMask)(char id) = nullptr;
  int (*dhdGetStatus)(int status[17], char id) = nullptr;
  const char* (*dhdErrorGetLastStr)() = nullptr;
  int (*dhdSetWatchdog)(unsigned char units_125_us, char id) = nullptr;
  // Only libdrd has these; without them a device is calibrated by hand.
  int (*drdOpenID)(char id) = nullptr;
  int (*drdClose)(char id) = nullptr;
  bool (*drdIsInitialized)(char id) = nullptr;
  int (*drdAutoInit)(char id) = nullptr;
  int (*drdStop)(bool force_on, char id) = nullptr;

  std::string path;     ///< of the library found
  std::string version;  ///< as it says of itself
  bool has_drd() const noexcept { return drdAutoInit != nullptr; }
};

/// Where to look; the defaults are the machine's.
struct SdkSearch {
  std::string fdsdk;  ///< $FDSDK, the folder where the SDK was unpacked; empty: not set
  std::string home;   ///< $HOME
  std::vector<std::string> loader_names{"libdrd.so.3", "libdhd.so.3"};  ///< by the loader's own path
  static SdkSearch of_this_machine();
};

/// Looks for libdrd, then libdhd: $FDSDK/lib/release/lin-x86_64-gcc, ~/.local/lib, the loader's path. The
/// library stays loaded as long as the program lives. Throws UserError: one line that says what was not
/// found or is missing in it, where it was looked for, and what to do.
Sdk load_sdk(const SdkSearch& search);

}  // namespace telenano::device
