#include "telenano/nve_server/scene/fields_cache.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <vector>

namespace telenano::scene {
namespace {

using physics::HeightGrid;
using physics::ScanFields;
using physics::SofteningRule;
using Words = std::vector<std::uint64_t>;

static_assert(std::endian::native == std::endian::little, "files are little-endian");

constexpr std::uint64_t kMagic = 0x31534c4649464e54;  // "TNFIFLS1"
constexpr std::uint64_t kMostGrids = 24;
constexpr const char* kPrefix = "fields-";

/// Closes what it holds.
class File {
 public:
  explicit File(int fd) : fd_(fd) {}
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  explicit operator bool() const { return fd_ >= 0; }
  int fd() const { return fd_; }

  bool read(void* to, std::size_t bytes) const {
    auto* at = static_cast<char*>(to);
    while (bytes > 0) {
      const ssize_t got = ::read(fd_, at, bytes);
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return false;
      at += got;
      bytes -= static_cast<std::size_t>(got);
    }
    return true;
  }
  bool write(const void* from, std::size_t bytes) const {
    const auto* at = static_cast<const char*>(from);
    while (bytes > 0) {
      const ssize_t put = ::write(fd_, at, bytes);
      if (put < 0 && errno == EINTR) continue;
      if (put <= 0) return false;
      at += put;
      bytes -= static_cast<std::size_t>(put);
    }
    return true;
  }

 private:
  int fd_;
};

/// Four FNV-1a by turns over whole words: against accidents, not against people.
class Checksum {
 public:
  explicit Checksum(std::uint64_t seed = 14695981039346656037ull) {
    for (std::uint64_t& lane : lanes_) lane = seed = mixed(seed, 1);
  }
  template <class Word>
  void add(std::span<const Word> words) {
    static_assert(sizeof(Word) == 8);
    std::size_t k = 0;
    for (; k + 4 <= words.size(); k += 4) {
      for (std::size_t i = 0; i < 4; ++i) {
        lanes_[i] = mixed(lanes_[i], std::bit_cast<std::uint64_t>(words[k + i]));
      }
    }
    for (; k < words.size(); ++k)
      lanes_[k % 4] = mixed(lanes_[k % 4], std::bit_cast<std::uint64_t>(words[k]));
  }
  std::uint64_t value() const {
    std::uint64_t all = 0;
    for (const std::uint64_t lane : lanes_) all = mixed(all, lane);
    return all;
  }

 private:
  static std::uint64_t mixed(std::uint64_t hash, std::uint64_t word) {
    hash = (hash ^ word) * 1099511628211ull;
    return hash ^ (hash >> 29);
  }
  std::uint64_t lanes_[4];
};

/// All that the fields depend on, to the bit.
Words key_of(const HeightGrid& grid, double radius, const SofteningRule& rule,
             const std::vector<double>& fixed, const physics::RetractionKernel* pull_off) {
  Words key = {ScanFields::kVersion, static_cast<std::uint64_t>(grid.columns),
               static_cast<std::uint64_t>(grid.rows)};
  for (const double value :
       {grid.dx_nm, grid.dy_nm, grid.x_first_nm, grid.y_first_nm, radius, rule.finest_nm, rule.coarsest_nm,
        rule.pressed_growth, rule.gap_growth, rule.dead_zone_nm, rule.pressed_onset_nm}) {
    key.push_back(std::bit_cast<std::uint64_t>(value));
  }
  key.push_back(pull_off != nullptr ? pull_off->hash() : 0);
  key.push_back(fixed.size());
  for (const double t : fixed) key.push_back(std::bit_cast<std::uint64_t>(t));
  for (const double z : grid.z_nm) key.push_back(std::bit_cast<std::uint64_t>(z));
  return key;
}

std::string name_of(const Words& key) {
  Checksum one(1), two(2);
  one.add(std::span<const std::uint64_t>(key));
  two.add(std::span<const std::uint64_t>(key));
  char name[64];
  std::snprintf(name, sizeof name, "%s%016llx%016llx.bin", kPrefix,
                static_cast<unsigned long long>(one.value()), static_cast<unsigned long long>(two.value()));
  return name;
}

bool is_absolute(const char* path) {
  return path != nullptr && path[0] == '/';
}

}  // namespace

std::string FieldsCache::folder_of_user() {
  if (const char* const own = std::getenv("TELENANO_CACHE")) {
    return std::string(own) == "off" ? std::string() : std::string(own);
  }
  if (const char* const service = std::getenv("CACHE_DIRECTORY"); is_absolute(service)) {
    return std::string(service) + "/fields";
  }
  if (const char* const xdg = std::getenv("XDG_CACHE_HOME"); is_absolute(xdg)) {
    return std::string(xdg) + "/telenano/fields";
  }
  if (const char* const home = std::getenv("HOME"); is_absolute(home)) {
    return std::string(home) + "/.cache/telenano/fields";
  }
  return {};
}

std::string users_fields_cache() {
  return FieldsCache::folder_of_user();
}

std::string FieldsCache::path(const HeightGrid& grid, double radius, const SofteningRule& rule,
                              const std::vector<double>& fixed,
                              const physics::RetractionKernel* pull_off) const {
  return folder_ + "/" + name_of(key_of(grid, radius, rule, fixed, pull_off));
}

std::optional<ScanFields> FieldsCache::find(const HeightGrid& grid, double radius, const SofteningRule& rule,
                                            const std::vector<double>& fixed,
                                            const physics::RetractionKernel* pull_off) const {
  const Words key = key_of(grid, radius, rule, fixed, pull_off);
  const File file(
      ::open((folder_ + "/" + name_of(key)).c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK));
  if (!file) return {};
  struct stat about {};
  if (::fstat(file.fd(), &about) != 0 || !S_ISREG(about.st_mode) || about.st_uid != ::geteuid() ||
      (about.st_mode & (S_IWGRP | S_IWOTH)) != 0) {
    return {};
  }
  // Nothing is reserved that the file's own size does not vouch for.
  std::uint64_t head[3];  // magic, words of the key, grids
  if (static_cast<std::uint64_t>(about.st_size) > most_bytes_ || !file.read(head, sizeof head)) return {};
  if (head[0] != kMagic || head[1] != key.size() || head[2] == 0 || head[2] > kMostGrids) return {};
  Words counts(head[2]);
  if (!file.read(counts.data(), counts.size() * 8)) return {};
  const std::uint64_t words = static_cast<std::uint64_t>(about.st_size) / 8;
  std::uint64_t all = 3 + counts.size() + key.size() + 1;
  for (const std::uint64_t count : counts) {
    if (count > words) return {};
    all += count;
  }
  if (about.st_size % 8 != 0 || all != words) return {};
  Words there(key.size());
  if (!file.read(there.data(), there.size() * 8) || there != key) return {};
  Checksum sum;
  sum.add(std::span<const std::uint64_t>(head));
  sum.add(std::span<const std::uint64_t>(counts));
  sum.add(std::span<const std::uint64_t>(key));
  std::vector<std::vector<double>> coefficients;
  for (const std::uint64_t count : counts) {
    coefficients.emplace_back(count);
    if (!file.read(coefficients.back().data(), count * 8)) return {};
    sum.add(std::span<const double>(coefficients.back()));
  }
  std::uint64_t said = 0;
  if (!file.read(&said, sizeof said) || said != sum.value()) return {};
  ::futimens(file.fd(), nullptr);  // last used now
  return ScanFields::restored(grid, radius, rule, fixed, std::move(coefficients));
}

void FieldsCache::make_room(std::uint64_t bytes) const {
  namespace fs = std::filesystem;
  struct Kept {
    fs::file_time_type used;
    std::uint64_t bytes;
    fs::path path;
  };
  std::vector<Kept> kept;
  std::uint64_t all = bytes;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
    std::error_code error;
    if (!entry.path().filename().string().starts_with(kPrefix) || !entry.is_regular_file(error)) continue;
    const Kept one{entry.last_write_time(error), entry.file_size(error), entry.path()};
    if (error) continue;
    all += one.bytes;
    kept.push_back(one);
  }
  std::sort(kept.begin(), kept.end(), [](const Kept& a, const Kept& b) { return a.used < b.used; });
  for (const Kept& oldest : kept) {
    if (all <= most_bytes_) return;
    std::error_code error;
    if (fs::remove(oldest.path, error)) all -= oldest.bytes;
  }
}

bool FieldsCache::keep(const HeightGrid& grid, double radius, const SofteningRule& rule,
                       const std::vector<double>& fixed, const ScanFields& fields,
                       const physics::RetractionKernel* pull_off) const noexcept {
  std::string beside;
  try {
    const Words key = key_of(grid, radius, rule, fixed, pull_off);
    const std::vector<std::span<const double>> coefficients = fields.coefficients();
    const Words head = {kMagic, key.size(), coefficients.size()};
    Words counts;
    std::uint64_t words = head.size() + coefficients.size() + key.size() + 1;
    for (const std::span<const double> of_grid : coefficients) {
      counts.push_back(of_grid.size());
      words += of_grid.size();
    }
    if (words > most_bytes_ / 8 || coefficients.size() > kMostGrids) return false;
    if (!std::filesystem::exists(folder_)) {
      std::filesystem::create_directories(std::filesystem::path(folder_).parent_path());
      if (::mkdir(folder_.c_str(), 0700) != 0 && errno != EEXIST) return false;
    }
    make_room(words * 8);
    const std::string path = folder_ + "/" + name_of(key);
    std::string name = path + ".XXXXXX";
    const File file(::mkostemp(name.data(), O_CLOEXEC));  // 0600
    if (!file) return false;
    beside = name;
    Checksum sum;
    bool good = true;
    const auto put = [&](auto part) {
      sum.add(part);
      good = good && file.write(part.data(), part.size() * 8);
    };
    put(std::span<const std::uint64_t>(head));
    put(std::span<const std::uint64_t>(counts));
    put(std::span<const std::uint64_t>(key));
    for (const std::span<const double> of_grid : coefficients) put(of_grid);
    const std::uint64_t value = sum.value();
    good = good && file.write(&value, sizeof value);
    if (good && ::rename(beside.c_str(), path.c_str()) == 0) return true;
  } catch (...) {
  }
  if (!beside.empty()) ::unlink(beside.c_str());
  return false;
}

}  // namespace telenano::scene
