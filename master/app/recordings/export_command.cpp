#include "telenano/master/app/recordings/export_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/program.h"
#include "telenano/common/recording/curve_segments.h"
#include "telenano/common/recording/recording_reader.h"

namespace telenano::app {
namespace {

using recording::Column;
using recording::ColumnType;
using recording::RecordingReader;
using recording::Sample;

struct ExportOptions {
  std::string file;
  std::string what = "samples";
  std::vector<std::string> columns;
  std::optional<double> from_s;
  std::optional<double> to_s;
  std::size_t every = 1;
};

constexpr const char* kAxes[] = {"_x", "_y", "_z"};
constexpr std::size_t kBlock = 4096;  // rows at once: memory stays small however long the recording

/// The columns asked for, in the order asked for; all that the recording has if none is named.
std::vector<const Column*> chosen_columns(const RecordingReader& reader,
                                          const std::vector<std::string>& names) {
  const auto table = recording::sample_columns();
  std::vector<const Column*> chosen;
  if (names.empty()) {
    for (const Column& column : table) {
      if (reader.has(column.name)) chosen.push_back(&column);
    }
    return chosen;
  }
  for (const std::string& name : names) {
    const auto found =
        std::find_if(table.begin(), table.end(), [&](const Column& c) { return name == c.name; });
    if (found == table.end() || !reader.has(name)) {
      std::string known;
      for (const std::string& column : reader.columns()) known += " " + column;
      throw UserError(reader.path().string() + ": has no column '" + name + "'; it has:" + known);
    }
    chosen.push_back(&*found);
  }
  return chosen;
}

/// 17 digits: what is read back is the number itself.
void print_value(const Sample& row, const Column& column, std::size_t component) {
  const char* at = reinterpret_cast<const char*>(&row) + column.offset + component * column.element_bytes();
  switch (column.type) {
    case ColumnType::kFloat64: {
      double value = 0;
      std::memcpy(&value, at, sizeof value);
      std::printf("%.17g", value);
      break;
    }
    case ColumnType::kInt64: {
      std::int64_t value = 0;
      std::memcpy(&value, at, sizeof value);
      std::printf("%" PRId64, value);
      break;
    }
    case ColumnType::kUint32: {
      std::uint32_t value = 0;
      std::memcpy(&value, at, sizeof value);
      std::printf("%" PRIu32, value);
      break;
    }
  }
}

bool within(const ExportOptions& options, double time_s) {
  return (!options.from_s || time_s >= *options.from_s) && (!options.to_s || time_s <= *options.to_s);
}

void export_samples(const RecordingReader& reader, const ExportOptions& options) {
  const auto columns = chosen_columns(reader, options.columns);
  bool first = true;
  for (const Column* column : columns) {
    for (std::size_t i = 0; i < column->components; ++i) {
      std::printf("%s%s%s", first ? "" : ",", column->name, column->components == 3 ? kAxes[i] : "");
      first = false;
    }
  }
  std::printf("\n");
  std::vector<Sample> block(std::min(kBlock, reader.rows()));
  std::size_t count = 0;
  for (std::size_t begin = 0; begin < reader.rows(); begin += block.size()) {
    const std::span<Sample> rows(block.data(), std::min(block.size(), reader.rows() - begin));
    reader.read_samples(begin, rows);
    config::require_stdout();
    for (const Sample& row : rows) {
      if (!within(options, row.time_s) || count++ % options.every != 0) continue;
      first = true;
      for (const Column* column : columns) {
        for (std::size_t i = 0; i < column->components; ++i) {
          if (!first) std::printf(",");
          first = false;
          print_value(row, *column, i);
        }
      }
      std::printf("\n");
    }
  }
}

/// Force against distance: the stretches in which the tip was driven down or up at one place.
void export_curves(const RecordingReader& reader, const ExportOptions& options) {
  const std::string surface = reader.configuration("surface_z_w_nm");
  const double surface_nm = surface.empty() ? 0.0 : std::strtod(surface.c_str(), nullptr);
  if (surface.empty())
    std::fprintf(stderr,
                 "telenano-master: %s does not say where the surface is: heights are those of frame W\n",
                 options.file.c_str());
  const auto above = [&](std::vector<double> values) {
    for (double& value : values) value -= surface_nm;
    return values;
  };
  const auto time_s = reader.read("time_s");
  const auto target_nm = above(reader.read("tip_target_w_nm", 2));
  const auto tip_nm = above(reader.read("tip_pos_w_nm", 2));
  const auto force_nn = reader.read("force_w_nn", 2);
  const auto deflection_nm = reader.read("deflection_nm");
  const auto sequence = reader.read("reply_sequence");
  const auto x_nm = reader.read("tip_target_w_nm", 0), y_nm = reader.read("tip_target_w_nm", 1);
  std::vector<double> lateral_nm(x_nm.size());
  for (std::size_t i = 0; i < x_nm.size(); ++i)
    lateral_nm[i] = std::hypot(x_nm[i] - x_nm.front(), y_nm[i] - y_nm.front());
  const auto segments =
      recording::find_curve_segments(target_nm, lateral_nm, recording::segment_threshold_nm(target_nm));
  std::printf("segment,way,time_s,target_height_nm,tip_height_nm,force_nn,deflection_nm\n");
  for (std::size_t segment = 0; segment < segments.size(); ++segment) {
    std::size_t count = 0;
    double last = 0;
    for (std::size_t i = segments[segment].begin; i < segments[segment].end; ++i) {
      // One row a reply: between two nothing new is known of the tip.
      if (!(sequence[i] > last)) continue;
      last = sequence[i];
      if (!within(options, time_s[i]) || count++ % options.every != 0) continue;
      std::printf("%zu,%s,%.9g,%.17g,%.17g,%.17g,%.17g\n", segment + 1,
                  segments[segment].approach ? "approach" : "retract", time_s[i], target_nm[i], tip_nm[i],
                  force_nn[i], deflection_nm[i]);
    }
  }
}

/// A field of a CSV file, in quotes where it needs them (RFC 4180).
std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"') result += '"';
    result += c;
  }
  return result + "\"";
}

void export_events(const RecordingReader& reader, const ExportOptions& options) {
  std::printf("tick,time_s,code,value,text\n");
  for (const recording::Event& event : reader.events()) {
    if (!within(options, event.time_s)) continue;
    const std::string text(event.text.data(), ::strnlen(event.text.data(), event.text.size()));
    std::printf("%" PRId64 ",%.9g,%" PRIu32 ",%" PRIu32 ",%s\n", event.tick, event.time_s, event.code,
                event.value, quoted(text).c_str());
  }
}

void export_configuration(const RecordingReader& reader) {
  std::printf("key,value\n");
  for (const auto& [key, value] : reader.configuration())
    std::printf("%s,%s\n", quoted(key).c_str(), quoted(value).c_str());
}

void export_columns(const RecordingReader& reader) {
  std::printf("column,unit,description\n");
  for (const std::string& name : reader.columns())
    std::printf("%s,%s,%s\n", name.c_str(), reader.unit(name).c_str(),
                quoted(reader.description(name)).c_str());
}

void run_export(const ExportOptions& options) {
  if (options.from_s && options.to_s && *options.from_s > *options.to_s)
    throw UserError("--from-s is later than --to-s");
  if (!options.columns.empty() && options.what != "samples")
    throw UserError("--columns works only with --what samples");
  const RecordingReader reader = RecordingReader::isolated(options.file);
  if (options.what == "samples") export_samples(reader, options);
  if (options.what == "curves") export_curves(reader, options);
  if (options.what == "events") export_events(reader, options);
  if (options.what == "configuration") export_configuration(reader);
  if (options.what == "columns") export_columns(reader);
}

}  // namespace

void add_export_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("export", "Print the contents of a recording as CSV");
  const auto options = std::make_shared<ExportOptions>();
  command->add_option("FILE", options->file, "recording to read")->required();
  command
      ->add_option("--what", options->what,
                   "samples: one row per tick; curves: force against distance, one segment per approach or "
                   "retraction; events: events and marks; columns: the columns of samples and their units; "
                   "configuration: the settings of the session")
      ->capture_default_str()
      ->check(CLI::IsMember({"samples", "curves", "events", "columns", "configuration"}));
  command
      ->add_option("--columns", options->columns,
                   "print only these columns of the samples, e.g. time_s,force_w_nn")
      ->delimiter(',');
  command->add_option("--from-s", options->from_s, "start at this time of the recording, s");
  command->add_option("--to-s", options->to_s, "stop at this time, s");
  command->add_option("--every", options->every, "print only every n-th row")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  command->callback([options] { run_export(*options); });
}

}  // namespace telenano::app
