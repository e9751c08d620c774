// A recording with changes anywhere, as a report and as the recovery read it. The input is what is changed,
// not the file: most bytes of a file are samples, and those that matter are found by taking only places that
// are not zero.
//
// Replayed, each input is read as the programs read it, in a process of its own, so that whatever happens to
// the HDF5 library becomes one clear line here. Fuzzed, the reading goes on in one process beside for many
// inputs, whose coverage is carried over (guided_reading.h). Where that process ends within the HDF5 library
// the input is read again as the programs do; where it ends within our own code, that is a finding.
#include <unistd.h>

#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>
#include <vector>

#include "fuzz_input.h"
#include "telenano/common/base/error.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/recording/recover.h"
#include "telenano/common/recording/summary.h"
#if TELENANO_FUZZ
#include "guided_reading.h"
#endif

namespace telenano::recording {
namespace {

namespace fs = std::filesystem;
using fuzz::Script;

std::vector<std::uint8_t> bytes_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  return {bytes.begin(), bytes.end()};
}

struct Base {
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint32_t> places;  ///< of what is not zero
};

class Bases {
 public:
  Bases() {
    const fs::path shm = "/dev/shm";
    folder_ =
        (fs::exists(shm) ? shm : fs::temp_directory_path()) / ("telenano_fuzz_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    RecorderOptions options;
    options.path = folder_ / "base.h5";
    options.flush_period_s = 0.01;
    Configuration configuration;
    configuration.scene_name = "flakes";
    configuration.scene_text = "name = \"flakes\"";
    {
      Recorder recorder(options, configuration);
      for (int i = 0; i < 20; ++i) {
        Sample sample;
        sample.tick = i;
        recorder.push(sample);
      }
      for (std::int64_t i = 0; i < 8; ++i) recorder.push(DatagramRow{i, 1'000'000 * (i + 1), 0, 0, 0, 1, 0});
      recorder.push(make_event(3, 0.003, 1, "begin"));
      while (recorder.rows_written() < 20) std::this_thread::sleep_for(std::chrono::milliseconds(5));
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      bases_[1].bytes = bytes_of(options.path);  // as a killed writer leaves it
    }
    bases_[0].bytes = bytes_of(options.path);
    for (Base& base : bases_) {
      for (std::uint32_t i = 0; i < base.bytes.size(); ++i)
        if (base.bytes[i] != 0) base.places.push_back(i);
    }
  }
  ~Bases() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  const Base& operator[](std::size_t i) const { return bases_[i]; }
  fs::path file() const { return folder_ / "input.h5"; }

 private:
  fs::path folder_;
  std::array<Base, 2> bases_;
};

std::vector<std::uint8_t> changed(const Base& base, Script& script) {
  std::vector<std::uint8_t> bytes = base.bytes;
  const auto place = [&]() -> std::size_t {
    const std::size_t at = base.places[script.word() % base.places.size()];
    const auto near = static_cast<std::int8_t>(script.byte());
    return std::min(at + static_cast<std::size_t>(near + 128) - std::min<std::size_t>(at, 128),
                    bytes.size() - 1);
  };
  for (int i = 0; i < 16 && !script.done() && !bytes.empty(); ++i) {
    switch (script.byte() % 5) {
      case 0: {
        const std::size_t at = place();
        const auto with = script.take(1 + script.byte() % 16u);
        for (std::size_t k = 0; k < with.size() && at + k < bytes.size(); ++k) bytes[at + k] = with[k];
        break;
      }
      case 1: {
        const std::size_t at = place();
        bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << script.byte() % 8);
        break;
      }
      case 2:
        bytes.resize(script.number(4) % (bytes.size() + 1));
        break;
      case 3: {
        const std::size_t from = base.places[script.word() % base.places.size()];
        const std::size_t to = base.places[script.word() % base.places.size()];
        const std::size_t n = script.byte();
        for (std::size_t k = 0; k < n && std::max(from, to) + k < bytes.size(); ++k)
          bytes[to + k] = bytes[from + k];
        break;
      }
      default: {
        const auto whole = script.take(SIZE_MAX);
        bytes.assign(whole.begin(), whole.end());
        break;
      }
    }
  }
  return bytes;
}

/// What a report wants of it.
void read_everything(const RecordingReader& reader) {
  for (const std::string& column : reader.columns()) {
    reader.unit(column);
    reader.description(column);
    FUZZ_CHECK(reader.read(column).size() == reader.rows());
  }
  for (const Event& event : reader.events()) FUZZ_CHECK(event.text.back() == '\0');
  reader.datagrams();
  reader.marks();
  reader.state_pieces();
  std::vector<Sample> samples(reader.rows());
  reader.read_samples(0, samples);
  reader.configuration();
  summarise(reader);
}

enum class Isolation : std::uint8_t { kOwnProcess, kHere };

/// One clear line, or everything.
void read_as(std::uint8_t kind, const fs::path& path, Isolation isolation) {
  const bool here = isolation == Isolation::kHere;
  const auto reader = [&] { return here ? RecordingReader(path) : RecordingReader::isolated(path); };
  try {
    if ((kind & 2) == 0) {
      read_everything(reader());
    } else if (!(here ? recover_here(path) : recover(path)).was_closed) {
      FUZZ_CHECK(reader().closed());
    }
  } catch (const UserError& error) {
    fuzz::check_error_line(error.what());
  } catch (const RunError& error) {
    fuzz::check_error_line(error.what());
  } catch (const std::exception&) {
    // Sizes that do not fit into memory: child_call makes one line of it.
    FUZZ_CHECK(here);
  }
}

void write_input(const Bases& bases, fuzz::Script script) {
  const auto bytes = changed(bases[script.byte() & 1], script);
  std::ofstream(bases.file(), std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace
}  // namespace telenano::recording

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano;
  using namespace telenano::recording;
  static const Bases bases;
  const std::uint8_t kind = size > 0 ? data[0] : 0;
  write_input(bases, {data, size});
#if TELENANO_FUZZ
  static fuzz::GuidedReading reading(
      "libhdf5", [](std::string_view request) { read_as(request[0], bases.file(), Isolation::kHere); });
  if (reading.goes_well({reinterpret_cast<const char*>(&kind), 1})) return 0;
  write_input(bases, {data, size});  // a recovery may have changed it
#endif
  read_as(kind, bases.file(), Isolation::kOwnProcess);
  return 0;
}
