#pragma once

#include <cstring>

#include "telenano/common/recording/sample.h"

namespace telenano::recording {

/// A row whose every field says which row, field and component it is, so that any mix-up in the file shows.
inline Sample numbered_row(std::int64_t number, double time_s) {
  Sample row;
  std::uint32_t field = 0;
  for (const Column& column : sample_columns()) {
    for (std::size_t component = 0; component < column.components; ++component) {
      auto* at = reinterpret_cast<unsigned char*>(&row) + column.offset + component * column.element_bytes();
      const double value = static_cast<double>(number) * 128 + field + 0.25 * static_cast<double>(component);
      if (column.type == ColumnType::kFloat64) {
        std::memcpy(at, &value, 8);
      } else if (column.type == ColumnType::kInt64) {
        const auto whole = static_cast<std::int64_t>(value);
        std::memcpy(at, &whole, 8);
      } else {
        const auto whole = static_cast<std::uint32_t>(value);
        std::memcpy(at, &whole, 4);
      }
    }
    ++field;
  }
  row.tick = number;
  row.time_s = time_s;
  return row;
}

/// What a column of numbered_row holds.
inline double numbered_value(std::int64_t number, std::size_t field, std::size_t component) {
  return static_cast<double>(number) * 128 + static_cast<double>(field) +
         0.25 * static_cast<double>(component);
}

}  // namespace telenano::recording
