#include "telenano/nve_server/app/sample/import_command.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/app/sample/gwyddion_convert.h"
#include "telenano/nve_server/app/sample/user_files.h"
#include "telenano/nve_server/import/channel_check.h"
#include "telenano/nve_server/import/clean_scan.h"
#include "telenano/nve_server/import/gwy_file.h"
#include "telenano/nve_server/import/imported_scene.h"
#include "telenano/nve_server/import/tip_erosion.h"
#include "telenano/nve_server/scene/levelling.h"

namespace telenano::app {
namespace {

constexpr int kSideMin = 2;  // as a .gsf that a scene reads
constexpr int kSideMax = 8192;
constexpr double kExtentMin_m = 1e-10;
constexpr double kExtentMax_m = 1e-3;
constexpr double kHeightMax_nm = 1e5;
constexpr double kSpikesHinted = 10.0;
constexpr std::size_t kHeaderMax = std::size_t{1} << 16;

struct ImportOptions {
  std::string file;
  std::string out;
  bool list = false;
  std::string channel;
  std::string level = "plane";
  std::string flatten = "none";
  std::string spikes = "none";
  bool fill_masked = false;
  double tip_radius_nm = 20;
  std::string deconvolve;  // a radius, "blind", or empty
  bool force = false;
};

template <class... Values>
std::string words(const Values&... values) {
  std::ostringstream text;
  text.precision(4);
  (text << ... << values);
  return text.str();
}

/// What came out of the file. `bytes` holds what the channels point to.
struct Source {
  std::string bytes;
  import::GwyFile gwy;
  std::optional<surface::Scan> gsf;
  bool converted = false;
};

void read_source(const std::string& path, Source& source) {
  source.bytes = read_user_file(path, "a scan", 1024);
  if (source.bytes.empty()) throw UserError(path + ": is empty, expected a scan");
  if (source.bytes.starts_with("Gwyddion Simple Field")) {
    source.gsf = surface::parse_gsf(source.bytes, path);
    return;
  }
  std::string original;  // of what is converted, the beginning
  if (!import::is_gwy(source.bytes)) {
    original = source.bytes.substr(0, kHeaderMax);
    source.bytes = convert_by_gwyddion(path);
    source.converted = true;
  }
  source.gwy = import::read_gwy(source.bytes);
  const char* whose = source.converted ? ": the file converted by Gwyddion " : ": ";
  if (!source.gwy.error.empty()) throw UserError(path + whose + source.gwy.error);
  if (source.gwy.channels.empty())
    throw UserError(path + ": has no image (only curves, volumes or point clouds)");
  for (const import::GwyChannel& channel : source.gwy.channels) {
    const std::string wrong = import::differs_from_wsxm(original, channel.field);
    if (!wrong.empty()) throw UserError(path + ": " + wrong);
  }
}

bool is_height(const import::GwyChannel& channel) {
  return channel.field.unit_z == "m" && channel.field.unit_xy == "m";
}

std::string shown(const import::GwyChannel& channel) {
  return std::to_string(channel.number) + " '" + channel.title + "'";
}

std::string all_shown(const import::GwyFile& file) {
  constexpr std::size_t kMost = 8;
  std::string text;
  for (std::size_t i = 0; i < file.channels.size() && i < kMost; ++i) {
    const std::string& unit = file.channels[i].field.unit_z;
    text += (i == 0 ? "" : ", ") + shown(file.channels[i]) + " in " + (unit.empty() ? "no unit" : unit);
  }
  return text + (file.channels.size() > kMost ? ", ...; all by --list" : "");
}

const import::GwyChannel& chosen(const Source& source, const ImportOptions& options) {
  const auto& channels = source.gwy.channels;
  if (options.channel.empty()) {
    const auto in_metres = std::count_if(channels.begin(), channels.end(), is_height);
    if (in_metres == 0) {
      throw UserError(options.file + ": has no channel of heights, in m over m; it has " +
                      all_shown(source.gwy));
    }
    for (const import::GwyChannel& channel : channels) {
      const import::TitleSays says = import::title_says(channel.title);
      if (is_height(channel) &&
          (says == import::TitleSays::kHeight || (in_metres == 1 && says == import::TitleSays::kNothing)))
        return channel;
    }
    throw UserError(
        options.file +
        ": none of its channels in metres is a height by its title: name one by --channel; it has " +
        all_shown(source.gwy));
  }
  const import::GwyChannel* found = nullptr;
  int number = -1;
  const char* end = options.channel.data() + options.channel.size();
  const auto [read, error] = std::from_chars(options.channel.data(), end, number);
  const bool is_number = error == std::errc() && read == end;
  for (const import::GwyChannel& channel : channels) {
    if (is_number ? channel.number != number : channel.title != options.channel) continue;
    if (found != nullptr) {
      throw UserError(options.file + ": --channel '" + import::printable(options.channel) +
                      "' is the title of more than one channel: give the number; it has " +
                      all_shown(source.gwy));
    }
    found = &channel;
  }
  if (found == nullptr) {
    throw UserError(options.file + ": there is no channel '" + import::printable(options.channel) +
                    "'; it has " + all_shown(source.gwy));
  }
  return *found;
}

struct Heights {
  surface::Scan scan;
  std::vector<bool> gap;
  std::size_t gaps = 0;    // no numbers
  std::size_t masked = 0;  // marked, and to be filled or not
};

/// The rows of the file from the top, those of the grid from the bottom. Throws UserError for what no scene
/// could read.
Heights heights_of(const import::GwyChannel& channel, const ImportOptions& options) {
  const import::GwyField& field = channel.field;
  const auto refuse = [&](const std::string& what) {
    throw UserError(options.file + ": channel " + shown(channel) + " " + what);
  };
  if (field.unit_z != "m")
    refuse("is in " + (field.unit_z.empty() ? "no unit" : "'" + field.unit_z + "'") +
           ", expected heights in 'm'");
  if (field.unit_xy != "m")
    refuse("lies over " + (field.unit_xy.empty() ? "no unit" : "'" + field.unit_xy + "'") + ", expected 'm'");
  if (field.columns < kSideMin || field.rows < kSideMin || field.columns > kSideMax || field.rows > kSideMax)
    refuse(words("has ", field.columns, " x ", field.rows, " pixels, expected 2 to 8192 a side"));
  for (const double extent : {field.width, field.height}) {
    if (!(extent >= kExtentMin_m && extent <= kExtentMax_m))
      refuse(words("is ", field.width, " m by ", field.height, " m, expected 1e-10 to 1e-3 m"));
  }
  Heights heights;
  surface::Scan& scan = heights.scan;
  scan.title = channel.title;
  scan.width_nm = field.width * kNmPerM;
  scan.height_nm = field.height * kNmPerM;
  scan.grid.columns = field.columns;
  scan.grid.rows = field.rows;
  scan.grid.dx_nm = scan.width_nm / field.columns;
  scan.grid.dy_nm = scan.height_nm / field.rows;
  scan.grid.x_first_nm = 0.5 * scan.grid.dx_nm;
  scan.grid.y_first_nm = 0.5 * scan.grid.dy_nm;
  scan.grid.z_nm.resize(field.count());
  heights.gap.assign(field.count(), false);
  const auto columns = static_cast<std::size_t>(field.columns);
  for (std::size_t i = 0; i < field.count(); ++i) {
    const std::size_t row = static_cast<std::size_t>(field.rows) - 1 - i / columns;
    const std::size_t at = row * columns + i % columns;
    const double z_nm = field.value(i) * kNmPerM;
    const bool marked = channel.mask && channel.mask->value(i) > 0.5;
    const bool missing = !std::isfinite(z_nm);
    heights.gaps += missing ? 1 : 0;
    heights.masked += marked ? 1 : 0;
    heights.gap[at] = missing || (marked && options.fill_masked);
    scan.grid.z_nm[at] = missing ? 0.0 : z_nm;
  }
  const auto unknown = static_cast<std::size_t>(std::count(heights.gap.begin(), heights.gap.end(), true));
  if (4 * unknown > field.count()) {
    refuse(words("has no height in ", unknown, " of ", field.count(),
                 " pixels, expected at least three quarters of them"));
  }
  import::fill_gaps(scan.grid, heights.gap);
  const auto [low, high] = std::minmax_element(scan.grid.z_nm.begin(), scan.grid.z_nm.end());
  if (!(*high - *low <= kHeightMax_nm))
    refuse(words("has heights over ", *high - *low, " nm, expected at most 1e5 nm (are they in m?)"));
  return heights;
}

void put_lowest_at_zero(surface::Scan& scan) {
  const double lowest = *std::min_element(scan.grid.z_nm.begin(), scan.grid.z_nm.end());
  for (double& z : scan.grid.z_nm) z -= lowest;
}

/// A line of output and of the scene's comments, "spikes         7 pixels ...".
class Account {
 public:
  void add(const char* head, const std::string& text) {
    char line[64];
    std::snprintf(line, sizeof line, "%-14s ", head);
    lines_ += line + text + "\n";
    comments_.push_back(std::string(head) + ": " + text);
  }
  void warn(const std::string& text) { warnings_.push_back(text); }
  const std::vector<std::string>& comments() const { return comments_; }
  /// In the end, so that what is refused on the way prints its one line alone.
  void print() const { std::fputs(lines_.c_str(), stdout); }
  void print_warnings(const std::string& file) const {
    std::fflush(stdout);
    for (const std::string& text : warnings_)
      std::fprintf(stderr, "telenano-nve: warning: %s: %s\n", file.c_str(), text.c_str());
  }

 private:
  std::string lines_;
  std::vector<std::string> comments_;
  std::vector<std::string> warnings_;
};

/// The whole of `text` as a number from `least` to `most`.
std::optional<double> number_within(const std::string& text, double least, double most) {
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [read, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || read != end || !(value >= least && value <= most)) return std::nullopt;
  return value;
}

std::optional<double> spike_limit(const ImportOptions& options) {
  if (options.spikes == "none") return std::nullopt;
  if (const auto sigma = number_within(options.spikes, 1, 1e6)) return sigma;
  throw UserError("--spikes is '" + import::printable(options.spikes) +
                  "', expected none, or how many times the noise of a pixel: 1 to 1e6");
}

void expect_radius(const char* flag, double radius_nm) {
  if (!(radius_nm >= 1.0 && radius_nm <= 1e4))
    throw UserError(words(flag, " is ", radius_nm, ", expected a radius of 1 to 1e4 nm"));
}

/// None: blind, or not asked for.
std::optional<double> deconvolve_radius_nm(const ImportOptions& options) {
  if (options.deconvolve.empty() || options.deconvolve == "blind") return std::nullopt;
  if (const auto radius_nm = number_within(options.deconvolve, 1, 1e4)) return radius_nm;
  throw UserError("--deconvolve-radius-nm is '" + import::printable(options.deconvolve) +
                  "', expected a radius of 1 to 1e4 nm, or blind");
}

void clean(surface::HeightGrid& grid, const ImportOptions& options, Account& account) {
  if (const auto sigma = spike_limit(options)) {
    const double noise_nm = import::pixel_noise_nm(grid);
    const std::size_t count = import::remove_spikes(grid, *sigma);
    account.add("spikes",
                words(count, " pixels that differ from their surroundings by more than ", *sigma,
                      " times the noise of a pixel (", noise_nm, " nm) replaced by the median around them"));
  } else if (const std::size_t count = import::count_spikes(grid, kSpikesHinted); count > 0) {
    account.warn(words(count, " single pixels stand out by more than ", kSpikesHinted,
                       " times the noise and will be felt: --spikes ", kSpikesHinted, " takes them out"));
  }
  if (options.flatten == "rows-median") {
    scene::level_lines(grid);
    account.add("flatten", words(grid.rows,
                                 " lines, each aligned by the median of its differences from the one "
                                 "below; the mean slope along y is lost"));
  }
  if (options.level == "plane") {
    const import::Plane plane = import::fit_plane(grid);
    import::subtract(grid, plane);
    account.add("level", words("plane of most of the scan taken out, slopes ", plane.slope_x, " along x and ",
                               plane.slope_y, " along y"));
    if (!plane.converged)
      account.warn(
          "no plane holds most of the scan: look at the result, or level it in Gwyddion and give --level "
          "none");
  }
}

/// The certainty as a scan, for whatever shows one.
surface::Scan certainty_of(const surface::Scan& scan, const import::Erosion& erosion) {
  surface::Scan map = scan;
  map.lowest_before_shift_nm = 0;
  map.title = "certainty: 1 nm where the tip has touched, 0 where the ground may be lower";
  for (std::size_t i = 0; i < map.grid.z_nm.size(); ++i) map.grid.z_nm[i] = erosion.certain[i] ? 1.0 : 0.0;
  return map;
}

/// Of the tip that measured: as given, or the bluntest that the scan allows.
double measuring_radius_nm(const surface::Scan& scan, const ImportOptions& options, Account& account) {
  if (const auto given = deconvolve_radius_nm(options)) return *given;
  // One normal pixel in 5e8 is six times the noise off.
  const double radius_nm = import::bluntest_radius_nm(scan.grid, 6.0 * import::pixel_noise_nm(scan.grid));
  if (radius_nm <= 1.0) {
    throw UserError(
        options.file +
        ": --deconvolve-radius-nm blind: the scan is sharper than any tip of 1 nm or more can make it: is "
        "it noise? Smooth it, or give the radius");
  }
  if (radius_nm >= 1e4) {
    throw UserError(
        options.file +
        ": --deconvolve-radius-nm blind: nothing in the scan is sharp enough to tell the tip: give the "
        "radius");
  }
  account.add("tip", words("the one that measured the scan was no blunter than ", radius_nm,
                           " nm; it was as blunt only if something in the scan is sharper"));
  return radius_nm;
}

auto deconvolve(surface::Scan& scan, double radius_nm, Account& account) {
  auto erosion = import::erode(scan.grid, radius_nm);
  double lowered_nm = 0;
  for (std::size_t i = 0; i < erosion.z_nm.size(); ++i)
    lowered_nm = std::max(lowered_nm, scan.grid.z_nm[i] - erosion.z_nm[i]);
  const double percent =
      100.0 * static_cast<double>(erosion.certain_count) / static_cast<double>(erosion.z_nm.size());
  account.add("deconvolved", words("eroded by a paraboloid of ", radius_nm, " nm radius, by up to ",
                                   lowered_nm, " nm; ", erosion.certain_count, " of ", erosion.z_nm.size(),
                                   " pixels certain (", percent, " %), elsewhere the ground may be lower"));
  account.add("such a tip", words("measures the scan to ", erosion.misfit_rms_nm, " nm rms, ",
                                  erosion.misfit_max_nm, " nm at most"));
  scan.grid.z_nm = erosion.z_nm;
  return erosion;
}

struct Targets {
  std::filesystem::path folder;
  std::string name;
  std::string scan;
  std::string certainty;
  std::string scene;
};

/// Before the work: a mistake is said at once.
Targets targets_of(const ImportOptions& options) {
  Targets targets;
  targets.name = import::plain_name(std::filesystem::path(options.file).stem().string());
  targets.folder = options.out.empty() ? targets.name : options.out;
  targets.scan = (targets.folder / (targets.name + ".gsf")).string();
  targets.certainty = (targets.folder / (targets.name + "_certainty.gsf")).string();
  targets.scene = (targets.folder / "scene.toml").string();
  std::error_code error;
  const auto status = std::filesystem::status(targets.folder, error);
  if (std::filesystem::exists(status) && !std::filesystem::is_directory(status))
    throw UserError(targets.folder.string() + ": exists but is not a folder: choose another with -o");
  std::vector<std::string> files{targets.scan, targets.scene};
  if (!options.deconvolve.empty()) files.push_back(targets.certainty);
  for (const std::string& file : files) {
    const auto there = std::filesystem::symlink_status(file, error);
    if (!std::filesystem::exists(there)) continue;
    if (!options.force)
      throw UserError(file + ": already exists: --force replaces it, or choose another folder with -o");
    // Also through another name or a link.
    if (std::filesystem::equivalent(file, options.file, error))
      throw UserError(file + ": is the file to import: choose another folder with -o");
  }
  return targets;
}

void list(const Source& source, const ImportOptions& options) {
  std::printf("channel,title,columns,rows,unit,lateral_unit,width,height,gaps,masked,usable\n");
  const auto quoted = [](const std::string& text) {
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
  };
  if (source.gsf) {
    const surface::Scan& scan = *source.gsf;
    std::printf("0,%s,%d,%d,m,m,%.9g,%.9g,0,0,yes\n", quoted(import::printable(scan.title)).c_str(),
                scan.grid.columns, scan.grid.rows, scan.width_nm / kNmPerM, scan.height_nm / kNmPerM);
  }
  for (const import::GwyChannel& channel : source.gwy.channels) {
    const import::GwyField& field = channel.field;
    std::size_t gaps = 0;
    std::size_t masked = 0;
    for (std::size_t i = 0; i < field.count(); ++i) {
      gaps += std::isfinite(field.value(i)) ? 0 : 1;
      masked += channel.mask && channel.mask->value(i) > 0.5 ? 1 : 0;
    }
    bool usable = true;
    try {
      if (is_height(channel))
        heights_of(channel, options);
      else
        usable = false;
    } catch (const UserError&) {
      usable = false;
    }
    std::printf("%d,%s,%d,%d,%s,%s,%.9g,%.9g,%zu,%zu,%s\n", channel.number, quoted(channel.title).c_str(),
                field.columns, field.rows, quoted(field.unit_z).c_str(), quoted(field.unit_xy).c_str(),
                field.width, field.height, gaps, masked, usable ? "yes" : "no");
  }
}

Heights take_channel(Source& source, const ImportOptions& options, Account& account) {
  const std::string name = std::filesystem::path(options.file).filename().string();
  const std::string how = source.converted ? ", converted by Gwyddion" : "";
  Heights heights;
  std::string title;
  if (source.gsf) {
    if (!options.channel.empty() && options.channel != "0" && options.channel != source.gsf->title) {
      throw UserError(options.file + ": there is no channel '" + import::printable(options.channel) +
                      "': a .gsf has one, 0 '" + import::printable(source.gsf->title) + "'");
    }
    if (options.channel.empty() && import::title_says(source.gsf->title) == import::TitleSays::kSignal) {
      throw UserError(options.file + ": '" + import::printable(source.gsf->title) +
                      "' is no height by its title: --channel 0 takes it all the same");
    }
    heights.scan = std::move(*source.gsf);
    title = "0 '" + import::printable(heights.scan.title) + "'";
  } else {
    const import::GwyChannel& channel = chosen(source, options);
    heights = heights_of(channel, options);
    title = shown(channel) + " of " + std::to_string(source.gwy.channels.size());
  }
  const surface::HeightGrid& grid = heights.scan.grid;
  account.add("from", name + how + ", channel " + title);
  account.add("scan", words(grid.columns, " x ", grid.rows, " pixels of ", grid.dx_nm, " x ", grid.dy_nm,
                            " nm, ", heights.scan.width_nm, " x ", heights.scan.height_nm, " nm"));
  if (heights.gaps > 0)
    account.add("gaps", words(heights.gaps, " pixels without a height filled smoothly from around them"));
  if (heights.masked > 0 && options.fill_masked)
    account.add("mask", words(heights.masked, " masked pixels filled smoothly from around them"));
  if (heights.masked > 0 && !options.fill_masked) {
    account.add("mask",
                words(heights.masked, " masked pixels left as they are; --fill-masked replaces them"));
  }
  return heights;
}

void run(const ImportOptions& options) {
  expect_radius("--tip-radius-nm", options.tip_radius_nm);
  deconvolve_radius_nm(options);
  spike_limit(options);
  Source source;
  if (options.list) {
    read_source(options.file, source);
    list(source, options);
    return;
  }
  const Targets targets = targets_of(options);
  read_source(options.file, source);
  Account account;
  Heights heights = take_channel(source, options, account);
  surface::Scan& scan = heights.scan;
  if (import::tip_too_wide(scan, options.tip_radius_nm)) {
    throw UserError(words(options.file, ": the scan, ", scan.width_nm, " x ", scan.height_nm,
                          " nm, is too small for a tip of ", options.tip_radius_nm,
                          " nm radius: expected --tip-radius-nm of at most four times its shorter side"));
  }
  clean(scan.grid, options, account);
  std::optional<import::Erosion> erosion;
  if (!options.deconvolve.empty())
    erosion = deconvolve(scan, measuring_radius_nm(scan, options, account), account);
  scan.lowest_before_shift_nm = 0;
  put_lowest_at_zero(scan);
  account.add("heights",
              words("0 to ", *std::max_element(scan.grid.z_nm.begin(), scan.grid.z_nm.end()), " nm"));
  if (import::pixels_coarse(scan.grid, options.tip_radius_nm)) {
    account.warn(words("pixels of ", std::max(scan.grid.dx_nm, scan.grid.dy_nm),
                       " nm are coarse for a tip of ", options.tip_radius_nm,
                       " nm radius (more than half of it): what it touches between them is interpolated"));
  }

  import::ImportedScene scene;
  scene.name = targets.name;
  scene.scan_file = targets.name + ".gsf";
  scene.comments = account.comments();
  scene.comments.insert(scene.comments.begin(), "Made by telenano-nve import.");
  scene.tip_radius_nm = options.tip_radius_nm;
  const std::string text = import::scene_text(scene, scan);
  std::error_code error;
  std::filesystem::create_directories(targets.folder, error);
  if (error) throw RunError(targets.folder.string() + ": the folder cannot be made: " + error.message());
  surface::write_gsf(targets.scan, scan);
  if (erosion) surface::write_gsf(targets.certainty, certainty_of(scan, *erosion));
  write_text(targets.scene, text);
  account.print();
  std::printf("%-14s %s, %s%s\n", "written", targets.scene.c_str(), targets.scan.c_str(),
              erosion ? (", " + targets.certainty).c_str() : "");
  std::printf("%-14s telenano-nve check --scene %s\n", "next", targets.scene.c_str());
  account.print_warnings(options.file);
}

}  // namespace

void add_import_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "import", "Make a scene from your own scan (.gwy, .gsf, and formats that Gwyddion reads)");
  auto options = std::make_shared<ImportOptions>();
  command
      ->add_option("file", options->file,
                   "Scan: .gwy or .gsf; Gwyddion, if installed, converts other formats")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("-o,--out", options->out,
                   "Folder for the scene and its scan (default: the file's name without its ending)")
      ->type_name("FOLDER");
  command->add_flag("--list", options->list, "Only list the channels, as CSV");
  command
      ->add_option("--channel", options->channel,
                   "Title or number of the channel (default: the first in m that is a height, Z, topography "
                   "or sensor by "
                   "its title, or the only one)")
      ->type_name("TITLE|NUMBER");
  command->add_option("--level", options->level, "plane: subtract the plane that most of the scan lies on")
      ->capture_default_str()
      ->check(CLI::IsMember({"plane", "none"}));
  command->add_option("--flatten", options->flatten, "rows-median: align the scan's lines")
      ->capture_default_str()
      ->check(CLI::IsMember({"rows-median", "none"}));
  command
      ->add_option("--spikes", options->spikes,
                   "Remove single pixels that stand out by more than this many times the noise, e.g. 10")
      ->capture_default_str()
      ->type_name("SIGMA|none");
  command->add_flag("--fill-masked", options->fill_masked,
                    "Fill the pixels under the channel's mask from their surroundings");
  command
      ->add_option("--tip-radius-nm", options->tip_radius_nm,
                   "Radius of the tip that will touch the sample, 1 to 1e4")
      ->capture_default_str();
  command
      ->add_option("--deconvolve-radius-nm", options->deconvolve,
                   "Remove the width of the tip that measured the scan: its radius, 1 to 1e4, or blind: the "
                   "bluntest tip that the scan allows; also writes NAME_certainty.gsf")
      ->type_name("R|blind");
  command->add_flag("--force", options->force, "Replace existing files");
  command->footer(
      "Writes FOLDER/NAME.gsf and FOLDER/scene.toml, whose comments say what was done. A scan "
      "holds no material data:\nedit the scene's [sample] and [probe]. Order of the steps: gaps, "
      "spikes, lines, plane, tip. Pixels without a height are filled smoothly, at most a quarter.");
  command->callback([options] { run(*options); });
}

}  // namespace telenano::app
