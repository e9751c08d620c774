#include "telenano/common/recording/recover.h"

#include <errno.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/child_call.h"
#include "telenano/common/recording/hdf5_handle.h"
#include "telenano/common/recording/packed.h"
#include "telenano/common/recording/recording_reader.h"

namespace telenano::recording {
namespace {

struct LockFile {
  explicit LockFile(const std::string& name) : fd(lock_recording(name.c_str())) {}
  ~LockFile() {
    if (fd >= 0) ::close(fd);
  }
  LockFile(const LockFile&) = delete;
  LockFile& operator=(const LockFile&) = delete;
  int fd;
};

/// Cuts a dataset to `rows`; returns how many rows it had.
std::uint64_t cut(hid_t file, const std::string& dataset_path, std::uint64_t rows, const std::string& name) {
  const Handle dataset(H5Dopen2(file, dataset_path.c_str(), H5P_DEFAULT), H5Dclose);
  const Handle space(H5Dget_space(dataset.get()), H5Sclose);
  std::array<hsize_t, 2> size{};
  const int rank = H5Sget_simple_extent_ndims(space.get());
  if (rank < 1 || rank > 2 || H5Sget_simple_extent_dims(space.get(), size.data(), nullptr) < 0) {
    throw RunError(name + ": cannot be recovered, " + dataset_path + " is unreadable: " + hdf5_reason());
  }
  const std::uint64_t had = size[0];
  if (had > rows) {
    size[0] = rows;
    if (H5Dset_extent(dataset.get(), size.data()) < 0) {
      throw RunError(name + ": cannot be recovered, " + dataset_path + " cannot be cut: " + hdf5_reason());
    }
  }
  return had;
}

/// The two properties that h5clear uses; they have no function of their own in the C interface.
Handle repairing_access() {
  Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  const hbool_t yes = 1;
  H5Pset(access.get(), "clear_status_flags", &yes);
  H5Pset(access.get(), "skip_eof_check", &yes);
  H5Pset_libver_bounds(access.get(), H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
  return access;
}

}  // namespace

Recovered recover_here(const std::filesystem::path& path) {
  const std::string name = path.string();
  Recovered result;
  std::vector<std::string> columns;
  {
    const RecordingReader reader(path);  // one clear line for anything that is not a recording
    columns = reader.columns();
    result.rows = reader.rows();
    result.events = reader.events().size();
    result.was_closed = reader.closed();
  }
  if (result.was_closed) return result;
  if (::access(name.c_str(), W_OK) != 0)
    throw UserError(name + ": cannot be recovered: " + std::strerror(errno));
  const LockFile lock(name);
  if (lock.fd < 0) throw UserError(name + ": is being recorded now; recover it when its program has ended");

  const Handle access = repairing_access();
  Handle file(H5Fopen(name.c_str(), H5F_ACC_RDWR, access.get()), H5Fclose);
  // Blocks may have been written beyond the end that the superblock knows; closing would cut them off.
  if (!file || H5Fincrement_filesize(file.get(), 0) < 0) {
    throw RunError(name + ": cannot be recovered: " + hdf5_reason());
  }
  std::uint64_t longest = 0;
  for (const std::string& column : columns) {
    longest = std::max(longest, cut(file.get(), column_path(file.get(), column), result.rows, name));
  }
  result.rows_cut = longest - std::min(longest, result.rows);
  cut(file.get(), kEventsDataset, result.events, name);
  {
    Progress progress;
    read_progress(file.get(), progress);
    const std::array<std::int64_t, kProgressFields> fields{static_cast<std::int64_t>(result.rows),
                                                           static_cast<std::int64_t>(result.events),
                                                           progress.rows_dropped, 2};
    const Handle dataset(H5Dopen2(file.get(), kProgressDataset, H5P_DEFAULT), H5Dclose);
    if (H5Dwrite(dataset.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, fields.data()) < 0) {
      throw RunError(name + ": cannot be recovered: " + hdf5_reason());
    }
  }
  if (!file.reset()) throw RunError(name + ": cannot be recovered: " + hdf5_reason());

  const RecordingReader proof(path);
  if (!proof.closed() || proof.rows() != result.rows) {
    throw RunError(name + ": was repaired but does not open plainly; try h5clear -s");
  }
  return result;
}

Recovered recover(const std::filesystem::path& path) {
  ChildCall child(path.string(), [&](std::string_view) { return Packer().put(recover_here(path)).take(); });
  const std::string answer = child.ask({});
  return Unpacker(answer).get<Recovered>();
}

}  // namespace telenano::recording
