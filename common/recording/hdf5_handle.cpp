#include "telenano/common/recording/hdf5_handle.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include <cstring>
#include <mutex>

namespace telenano::recording {
namespace {

herr_t keep_reason(unsigned, const H5E_error2_t* error, void* text) {
  if (error->desc == nullptr) return 0;
  const std::string description = error->desc;
  static constexpr char kMark[] = "error message = '";
  const auto begin = description.find(kMark);
  auto& reason = *static_cast<std::string*>(text);
  if (begin == std::string::npos) {
    if (reason.empty()) reason = description;  // innermost first
    return 0;
  }
  const auto from = begin + sizeof kMark - 1;
  reason = description.substr(from,
                              description.find('\'', from) - from);  // what the operating system said is best
  return 1;
}

}  // namespace

void prepare_hdf5() {
  static std::once_flag once;
  std::call_once(once, [] {
    H5dont_atexit();
    // A file may name code and other files that the library would go and get: ours needs neither.
    H5PLset_loading_state(0);
    H5Lunregister(H5L_TYPE_EXTERNAL);
  });
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

std::string hdf5_reason() {
  std::string reason;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, keep_reason, &reason);
  H5Eclear2(H5E_DEFAULT);  // its texts would outlive the thread
  return reason.empty() ? "unknown HDF5 error" : reason;
}

std::string column_path(hid_t file, const std::string& column) {
  std::string path = std::string(kSamplesGroup) + "/" + column;
  if (H5Lexists(file, path.c_str(), H5P_DEFAULT) > 0) return path;
  for (const RenamedColumn& renamed : renamed_columns()) {
    if (column == renamed.name) return std::string(kSamplesGroup) + "/" + renamed.former;
  }
  return path;
}

hid_t memory_type(ColumnType type) {
  switch (type) {
    case ColumnType::kInt64:
      return H5T_NATIVE_INT64;
    case ColumnType::kUint32:
      return H5T_NATIVE_UINT32;
    case ColumnType::kFloat64:
      break;
  }
  return H5T_NATIVE_DOUBLE;
}

hid_t file_type(ColumnType type) {
  switch (type) {
    case ColumnType::kInt64:
      return H5T_STD_I64LE;
    case ColumnType::kUint32:
      return H5T_STD_U32LE;
    case ColumnType::kFloat64:
      break;
  }
  return H5T_IEEE_F64LE;
}

Handle datagram_type() {
  Handle type(H5Tcreate(H5T_COMPOUND, sizeof(DatagramRow)), H5Tclose);
  H5Tinsert(type.get(), "tick", offsetof(DatagramRow, tick), H5T_STD_I64LE);
  H5Tinsert(type.get(), "came_ns", offsetof(DatagramRow, came_ns), H5T_STD_I64LE);
  H5Tinsert(type.get(), "sequence", offsetof(DatagramRow, sequence), H5T_STD_U64LE);
  H5Tinsert(type.get(), "answers", offsetof(DatagramRow, answers), H5T_STD_U64LE);
  H5Tinsert(type.get(), "steps_before", offsetof(DatagramRow, steps_before), H5T_STD_U64LE);
  H5Tinsert(type.get(), "executed", offsetof(DatagramRow, executed), H5T_STD_U64LE);
  H5Tinsert(type.get(), "type", offsetof(DatagramRow, type), H5T_STD_U32LE);
  H5Tinsert(type.get(), "drop", offsetof(DatagramRow, drop), H5T_STD_U32LE);
  H5Tinsert(type.get(), "state_hash", offsetof(DatagramRow, state_hash), H5T_STD_U64LE);
  H5Tinsert(type.get(), "newest", offsetof(DatagramRow, newest), H5T_STD_U64LE);
  H5Tinsert(type.get(), "break_step", offsetof(DatagramRow, break_step), H5T_STD_U64LE);
  H5Tinsert(type.get(), "breaks", offsetof(DatagramRow, breaks), H5T_STD_U32LE);
  H5Tinsert(type.get(), "break_reason", offsetof(DatagramRow, break_reason), H5T_STD_U32LE);
  H5Tinsert(type.get(), "epoch", offsetof(DatagramRow, epoch), H5T_STD_U64LE);
  H5Tinsert(type.get(), "left_out", offsetof(DatagramRow, left_out), H5T_STD_U64LE);
  return type;
}

Handle state_piece_type() {
  const hsize_t bytes = StatePieceRow::kBytes;
  const Handle data(H5Tarray_create2(H5T_STD_U8LE, 1, &bytes), H5Tclose);
  Handle type(H5Tcreate(H5T_COMPOUND, sizeof(StatePieceRow)), H5Tclose);
  H5Tinsert(type.get(), "tick", offsetof(StatePieceRow, tick), H5T_STD_I64LE);
  H5Tinsert(type.get(), "step", offsetof(StatePieceRow, step), H5T_STD_U64LE);
  H5Tinsert(type.get(), "state_hash", offsetof(StatePieceRow, state_hash), H5T_STD_U64LE);
  H5Tinsert(type.get(), "breaks", offsetof(StatePieceRow, breaks), H5T_STD_U32LE);
  H5Tinsert(type.get(), "snapshot", offsetof(StatePieceRow, snapshot), H5T_STD_U32LE);
  H5Tinsert(type.get(), "piece", offsetof(StatePieceRow, piece), H5T_STD_U32LE);
  H5Tinsert(type.get(), "total", offsetof(StatePieceRow, total), H5T_STD_U32LE);
  H5Tinsert(type.get(), "size", offsetof(StatePieceRow, size), H5T_STD_U32LE);
  H5Tinsert(type.get(), "reserved", offsetof(StatePieceRow, reserved), H5T_STD_U32LE);
  H5Tinsert(type.get(), "data", offsetof(StatePieceRow, data), data.get());
  return type;
}

Handle mark_type() {
  Handle type(H5Tcreate(H5T_COMPOUND, sizeof(MarkRow)), H5Tclose);
  H5Tinsert(type.get(), "time_s", offsetof(MarkRow, time_s), H5T_IEEE_F64LE);
  H5Tinsert(type.get(), "column", offsetof(MarkRow, column), H5T_STD_U32LE);
  H5Tinsert(type.get(), "row", offsetof(MarkRow, row), H5T_STD_U32LE);
  H5Tinsert(type.get(), "value", offsetof(MarkRow, value), H5T_IEEE_F64LE);
  return type;
}

Handle event_type(bool packed) {
  Handle text(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(text.get(), sizeof(Event::text));
  H5Tset_strpad(text.get(), H5T_STR_NULLPAD);
  Handle type(H5Tcreate(H5T_COMPOUND, sizeof(Event)), H5Tclose);
  H5Tinsert(type.get(), "tick", offsetof(Event, tick), H5T_STD_I64LE);
  H5Tinsert(type.get(), "time_s", offsetof(Event, time_s), H5T_IEEE_F64LE);
  H5Tinsert(type.get(), "code", offsetof(Event, code), H5T_STD_U32LE);
  H5Tinsert(type.get(), "value", offsetof(Event, value), H5T_STD_U32LE);
  H5Tinsert(type.get(), "text", offsetof(Event, text), text.get());
  if (packed) H5Tpack(type.get());
  return type;
}

bool is_single(hid_t attribute) {
  const Handle space(H5Aget_space(attribute), H5Sclose);
  return space && H5Sget_simple_extent_npoints(space.get()) == 1;
}

bool read_text_attribute(hid_t object, const char* name, std::string& text) {
  if (H5Aexists(object, name) <= 0) return false;
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  if (!attribute) return false;
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  if (!type || H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0) return false;
  const std::size_t size = H5Tget_size(type.get());
  if (size > kTextBytesMax || !is_single(attribute.get())) return false;
  std::string read(size, '\0');
  if (H5Aread(attribute.get(), type.get(), read.data()) < 0) return false;
  read.resize(std::strlen(read.c_str()));
  text = std::move(read);
  return true;
}

bool write_text_attribute(hid_t object, const char* name, const std::string& text) {
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  if (H5Tset_size(type.get(), text.size() + 1) < 0 || H5Tset_cset(type.get(), H5T_CSET_UTF8) < 0)
    return false;
  const Handle attribute(H5Acreate2(object, name, type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT),
                         H5Aclose);
  return attribute && H5Awrite(attribute.get(), type.get(), text.c_str()) >= 0;
}

bool read_progress(hid_t file, Progress& progress) {
  const Handle dataset(H5Dopen2(file, kProgressDataset, H5P_DEFAULT), H5Dclose);
  if (!dataset) return false;
  const Handle space(H5Dget_space(dataset.get()), H5Sclose);
  if (!space || H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(kProgressFields))
    return false;
  std::int64_t fields[kProgressFields] = {};
  if (H5Dread(dataset.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, fields) < 0) return false;
  progress = {fields[0], fields[1], fields[2], fields[3]};
  return true;
}

int lock_recording(const char* path) {
  const int fd = ::open(path, O_RDWR | O_CLOEXEC);
  if (fd < 0) return -1;
  struct flock range {};
  range.l_type = F_WRLCK;
  range.l_whence = SEEK_SET;
  range.l_start = off_t{1} << 60;
  range.l_len = 1;
  if (::fcntl(fd, F_OFD_SETLK, &range) != 0 && (errno == EAGAIN || errno == EACCES)) {
    ::close(fd);
    return -1;
  }
  return fd;
}

}  // namespace telenano::recording
