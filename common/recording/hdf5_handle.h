#pragma once

#include <hdf5.h>

#include <cstddef>
#include <string>
#include <utility>

#include "telenano/common/recording/datagram_row.h"
#include "telenano/common/recording/mark_row.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/state_piece_row.h"

/// The little of HDF5 that writer, reader and recovery share. Included by this folder's .cpp files only.
namespace telenano::recording {

/// Owns an HDF5 identifier of whatever kind.
class Handle {
 public:
  Handle() = default;
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    if (this != &other) {
      reset();
      id_ = std::exchange(other.id_, -1);
      close_ = other.close_;
    }
    return *this;
  }
  ~Handle() { reset(); }

  hid_t get() const noexcept { return id_; }
  explicit operator bool() const noexcept { return id_ >= 0; }
  /// Closes and says whether that went well.
  bool reset() noexcept { return id_ < 0 || close_(std::exchange(id_, -1)) >= 0; }
  /// Forgets the identifier without closing it.
  void abandon() noexcept { id_ = -1; }

 private:
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

inline constexpr const char* kFormatName = "telenano-recording";
inline constexpr std::uint32_t kFormatVersion = 1;
inline constexpr const char* kSamplesGroup = "/samples";
/// Where the file keeps a column: under its name, or the one that an earlier program gave it.
std::string column_path(hid_t file, const std::string& column);
inline constexpr const char* kConfigurationGroup = "/configuration";
inline constexpr const char* kEventsDataset = "/events";
inline constexpr const char* kDatagramsDataset = "/datagrams";
inline constexpr const char* kMarksDataset = "/marks";
inline constexpr const char* kStatePiecesDataset = "/state_pieces";
inline constexpr const char* kProgressDataset = "/progress";

/// /progress: what the writer has confirmed after everything before it had been written.
struct Progress {
  std::int64_t rows = 0;
  std::int64_t events = 0;
  std::int64_t rows_dropped = 0;
  std::int64_t closed = 0;  ///< 1 once the writer ended in good order, 2 once recovery mended the file
};
inline constexpr std::size_t kProgressFields = 4;

/// Turns off HDF5's own printing for this thread and keeps the library from tidying up at exit, where it
/// would write again to a file whose disk is full. Call it before anything else in every thread that uses
/// HDF5.
void prepare_hdf5();

/// The innermost reason of the last HDF5 error of this thread, e.g. "No space left on device".
std::string hdf5_reason();

hid_t memory_type(ColumnType type);
hid_t file_type(ColumnType type);
/// A compound of Event; `packed` as it lies in the file, otherwise as it lies in memory.
Handle event_type(bool packed);
/// Compounds of DatagramRow, MarkRow and StatePieceRow, which have no padding.
Handle datagram_type();
Handle state_piece_type();
Handle mark_type();

/// Has the attribute one value? H5Aread writes as many as the file says, whatever the room.
bool is_single(hid_t attribute);

/// False when the attribute is missing or not a string (of at most 16 MiB).
inline constexpr std::size_t kTextBytesMax = std::size_t{1} << 24;
bool read_text_attribute(hid_t object, const char* name, std::string& text);
bool write_text_attribute(hid_t object, const char* name, const std::string& text);

bool read_progress(hid_t file, Progress& progress);

/// A writer holds this lock while it lives, so that recovery never mends a file that is being written. An
/// open file description lock on one byte far beyond the data: it does not touch the locks that HDF5 itself
/// takes. Returns the descriptor that holds the lock, or -1 when another holds it; on file systems without
/// locks the descriptor is returned all the same.
int lock_recording(const char* path);

}  // namespace telenano::recording
