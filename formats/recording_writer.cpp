#include "formats/hdf5_support.h"
#include "formats/output_file.h"
#include "formats/recording_layout.h"

#include <algorithm>
#include <boost/uuid/uuid_generators.hpp>
#include <boost/uuid/uuid_io.hpp>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using hdf5::checked;

constexpr std::size_t kEventsPerChunk = 64;

/// One row of values that were never written.
std::vector<std::byte> fill_row(const layout::Column& column) {
  std::vector<std::byte> row(column.row_bytes());
  const float narrow = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < column.width; ++i) {
    if (column.element == layout::Element::float64) std::memcpy(row.data() + 8 * i, &kNaN, 8);
    if (column.element == layout::Element::float32) std::memcpy(row.data() + 4 * i, &narrow, 4);
  }
  return row;
}

std::vector<std::byte> event_row(const StoredEvent& event) {
  std::vector<std::byte> row(layout::EventRow::kBytes);
  std::memcpy(row.data() + layout::EventRow::kTime, &event.time, sizeof event.time);
  std::memcpy(row.data() + layout::EventRow::kCode, &event.code, sizeof event.code);
  const std::string_view text = layout::utf8_prefix(event.text, layout::EventRow::kTextBytes - 1);
  std::memcpy(row.data() + layout::EventRow::kText, text.data(), text.size());
  return row;
}

/// A dataset that grows by whole chunks, which go to the file as they lie in memory: past HDF5's selections, its
/// conversions and its chunk cache.
class Table {
 public:
  /// `width` 1 makes the shape [N], else [N, width].
  Table(hid_t file, const std::string& path, hid_t type, std::size_t width, std::size_t rows_per_chunk,
        const char* units, const char* description, std::vector<std::byte> fill)
      : path_(path), fill_(std::move(fill)), chunk_rows_(rows_per_chunk), rank_(width > 1 ? 2 : 1), width_(width) {
    buffer_.resize(fill_.size() * chunk_rows_);
    const hsize_t none[] = {0, width}, unlimited[] = {H5S_UNLIMITED, width}, chunk[] = {chunk_rows_, width};
    const hdf5::Space space(H5Screate_simple(rank_, none, unlimited));
    const hdf5::Properties creation(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_chunk(creation.get(), rank_, chunk);
    // The fill value is one element: the first of a row, all of which are alike.
    H5Pset_fill_value(creation.get(), type, fill_.data());
    dataset_ = hdf5::Dataset(
        checked(H5Dcreate2(file, path.c_str(), type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
                path + " cannot be created"));
    hdf5::create_attribute(dataset_.get(), "units", std::string(units));
    hdf5::create_attribute(dataset_.get(), "description", std::string(description));
  }

  [[nodiscard]] std::size_t room() const { return chunk_rows_ - used_; }
  [[nodiscard]] std::byte* end() { return buffer_.data() + used_ * fill_.size(); }

  /// `count` rows were put at end(); write() must follow when there is no more room.
  void advance(std::size_t count) {
    used_ += count;
    written_ = false;
  }

  /// Puts the present chunk into the file, whole, with fill values where it has no rows yet.
  void write() {
    if (written_) return;
    for (std::size_t row = used_; row < chunk_rows_; ++row)
      std::copy(fill_.begin(), fill_.end(), buffer_.begin() + static_cast<std::ptrdiff_t>(row * fill_.size()));
    const hsize_t extent[] = {first_ + used_, width_}, offset[] = {first_, 0};
    checked(H5Dset_extent(dataset_.get(), extent), path_ + " cannot grow");
    checked(H5Dwrite_chunk(dataset_.get(), H5P_DEFAULT, 0, offset, buffer_.size(), buffer_.data()),
            path_ + " cannot be written");
    written_ = true;
    if (used_ == chunk_rows_) {
      first_ += used_;
      used_ = 0;
    }
  }

 private:
  std::string path_;
  hdf5::Dataset dataset_;
  std::vector<std::byte> buffer_;
  std::vector<std::byte> fill_;
  std::size_t chunk_rows_;
  int rank_;
  hsize_t width_;
  hsize_t first_ = 0;     ///< row of the file where the buffer begins
  std::size_t used_ = 0;  ///< rows in the buffer
  bool written_ = true;   ///< the file has all of the buffer's rows
};

/// Disk space claimed beyond the end of the file. A disk that fills up refuses the claim, and no write of HDF5's: the
/// recording ends in good order with everything in it.
class Reserve {
 public:
  /// `largest` is the most that is written between two claims, without HDF5's own bookkeeping.
  Reserve(int descriptor, std::size_t largest)
      : descriptor_(fcntl(descriptor, F_DUPFD_CLOEXEC, 0)), ahead_(2 * (kBookkeeping + largest)) {}
  ~Reserve() {
    // What was claimed in vain goes back to the disk.
    struct stat status {};
    if (fstat(descriptor_, &status) == 0 && ftruncate(descriptor_, status.st_size) != 0) errno = 0;
    ::close(descriptor_);
  }
  Reserve(const Reserve&) = delete;
  Reserve& operator=(const Reserve&) = delete;

  /// Sees to it that the file, now `end` bytes long, can grow. The reason why not, or empty.
  std::string claim(std::uint64_t end) {
    if (end + ahead_ / 2 <= claimed_) return {};
    if (std::string refusal = process_limit(end + ahead_); !refusal.empty()) return refusal;
    while (fallocate(descriptor_, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(end), static_cast<off_t>(ahead_)) != 0) {
      if (errno == EINTR) continue;
      // File systems that cannot claim go without; HDF5 then learns of a full disk by itself.
      if (errno != ENOSPC && errno != EDQUOT && errno != EFBIG && errno != EIO) break;
      return std::strerror(errno);
    }
    claimed_ = end + ahead_;
    return {};
  }

  /// Why this process may not have a file of `bytes`, or empty.
  static std::string process_limit(std::uint64_t bytes) {
    rlimit limit{};
    if (getrlimit(RLIMIT_FSIZE, &limit) != 0 || bytes <= limit.rlim_cur) return {};
    return fmt::format("files of this process may have {} bytes at most (ulimit -f)", limit.rlim_cur);
  }

  static constexpr std::uint64_t kBookkeeping = 1 << 20;  ///< room for HDF5's own [bytes]

 private:
  int descriptor_;
  std::uint64_t ahead_;  ///< claimed at once; half of it always remains
  std::uint64_t claimed_ = 0;
};

void check_texts(const RecordingHeader& header) {
  for (const layout::Attribute& attribute : layout::attributes()) {
    std::size_t bytes = 0;
    if (const auto* text = std::get_if<std::string RecordingHeader::*>(&attribute.member))
      bytes = (header.**text).size();
    if (const auto* json = std::get_if<nlohmann::json RecordingHeader::*>(&attribute.member))
      bytes = (header.**json).dump().size();
    if (bytes > layout::kLongestText)
      throw input_error(fmt::format("{} has {} bytes; a recording keeps at most {}: shorten it", attribute.name, bytes,
                                    layout::kLongestText));
  }
}

void create_attributes(hid_t root, const RecordingHeader& header) {
  hdf5::create_attribute(root, "format", std::string(layout::kFormat));
  for (const layout::Attribute& attribute : layout::attributes())
    std::visit(
        [&](auto member) {
          if constexpr (std::is_same_v<decltype(member), nlohmann::json RecordingHeader::*>)
            hdf5::create_attribute(root, attribute.name, (header.*member).dump());
          else
            hdf5::create_attribute(root, attribute.name, header.*member);
        },
        attribute.member);
}

hdf5::File create_file(const std::string& file) {
  const hdf5::Properties creation(H5Pcreate(H5P_FILE_CREATE)), access(H5Pcreate(H5P_FILE_ACCESS));
  // Attributes in the object header have fixed places, so that `complete` may change while others read.
  H5Pset_attr_phase_change(creation.get(), 64, 0);
  H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110);
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  const hid_t id = H5Fcreate(file.c_str(), H5F_ACC_EXCL, creation.get(), access.get());
  if (id >= 0) return hdf5::File(id);
  const std::string reason = hdf5::last_error();
  std::error_code ignored;
  if (reason != std::strerror(EEXIST)) fs::remove(file, ignored);
  throw input_error("cannot be created: " + reason);
}

}  // namespace

struct RecordingWriter::File {
  std::string name;
  hdf5::File file;
  std::optional<Reserve> reserve;
  std::vector<const layout::Column*> columns;
  std::vector<Table> tables;  ///< one per column
  std::optional<Table> events;
  std::uint64_t rows = 0;
  std::string failure;  ///< why writing stopped; empty while it goes on

  /// Runs something that writes. After its first failure nothing is written any more.
  template <class Action>
  void guarded(const Action& action) {
    if (!failure.empty()) throw Error(Error::Kind::fault, failure);
    if (!file) throw Error(Error::Kind::fault, name + ": the recording is closed already");
    const hdf5::Silence silence;
    try {
      action();
    } catch (const Error& error) {
      failure = fmt::format("{}: recording stopped after {} samples: {}", name, rows, error.what());
      close_broken();
      throw Error(Error::Kind::fault, failure);
    }
  }

  /// Time comes last: a row that has a time has everything, whatever happens in between.
  void write_samples() {
    for (auto table = tables.rbegin(); table != tables.rend(); ++table) table->write();
  }

  void flush() {
    write_samples();
    events->write();
    checked(H5Fflush(file.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
  }

  /// Throws when the disk has no room for what may come next; everything so far is then in the file, which is closed.
  void claim_room() {
    hsize_t end = 0;
    checked(H5Fget_filesize(file.get(), &end), "has no size");
    const std::string refusal = reserve->claim(end);
    if (refusal.empty()) return;
    flush();
    if (!close()) throw input_error("cannot be closed: " + hdf5::last_error());
    throw input_error(refusal);
  }

  /// False when HDF5 could not.
  bool close() noexcept {
    tables.clear();
    events.reset();
    const bool closed = file.close();
    reserve.reset();
    return closed;
  }

  /// Closes a file that cannot be written any more. HDF5 would try, fail half-way with a superblock that nobody can
  /// read, and crash at the end of the program: so what it still wants to write goes nowhere, and the file stays as the
  /// last flush left it.
  void close_broken() noexcept {
    void* descriptor = nullptr;
    const int nowhere = memfd_create("haptrace", MFD_CLOEXEC);
    if (file && nowhere >= 0 && H5Fget_vfd_handle(file.get(), H5P_DEFAULT, &descriptor) >= 0)
      dup2(nowhere, *static_cast<int*>(descriptor));
    if (nowhere >= 0) ::close(nowhere);
    close();
  }

  void create(const RecordingHeader& header, const RecordingColumns& chosen, std::size_t rows_per_chunk) {
    create_attributes(file.get(), header);
    const hdf5::Group samples(
        checked(H5Gcreate2(file.get(), "/samples", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "/samples"));
    std::size_t chunk_bytes = 0;
    for (const layout::Column& column : layout::columns()) {
      if (!column.in(chosen)) continue;
      columns.push_back(&column);
      tables.emplace_back(file.get(), column.path(), hdf5::stored_type(column.element), column.width, rows_per_chunk,
                          column.units, column.description, fill_row(column));
      chunk_bytes += rows_per_chunk * column.row_bytes();
    }
    events.emplace(file.get(), layout::kEvents, hdf5::event_type().get(), 1, kEventsPerChunk, layout::kEventUnits,
                   layout::kEventDescription, event_row({kNaN, 0, ""}));

    void* descriptor = nullptr;
    checked(H5Fget_vfd_handle(file.get(), H5P_DEFAULT, &descriptor), "has no descriptor");
    reserve.emplace(*static_cast<int*>(descriptor), chunk_bytes);
    if (const std::string refusal = reserve->claim(0); !refusal.empty()) throw input_error(refusal);
    checked(H5Fstart_swmr_write(file.get()), "cannot be opened to live readers");
  }
};

RecordingWriter::RecordingWriter(const std::string& file, const RecordingHeader& header,
                                 const RecordingColumns& columns, const Options& options)
    : file_(std::make_unique<File>()) {
  const hdf5::Silence silence;
  OutputFile output(file, options.overwrite);
  if (options.rows_per_chunk == 0) throw input_error("rows_per_chunk must be at least 1");

  RecordingHeader stored = header;
  if (stored.uuid.empty()) stored.uuid = boost::uuids::to_string(boost::uuids::random_generator()());
  if (stored.created.empty())
    stored.created = fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::chrono::system_clock::now()));
  stored.complete = false;

  file_->name = file;
  try {
    check_texts(stored);
    if (const std::string refusal = Reserve::process_limit(Reserve::kBookkeeping); !refusal.empty())
      throw input_error(refusal);
    file_->file = create_file(output.path());
    output.created();
    file_->create(stored, columns, options.rows_per_chunk);
  } catch (const Error& error) {
    file_->close_broken();
    throw input_error(fmt::format("{}: {}", file, error.what()));
  }
  output.commit();
}

RecordingWriter::~RecordingWriter() {
  abandon();
}

RecordingWriter::RecordingWriter(RecordingWriter&&) noexcept = default;

RecordingWriter& RecordingWriter::operator=(RecordingWriter&& other) noexcept {
  std::swap(file_, other.file_);
  return *this;
}

void RecordingWriter::append(std::span<const Sample> samples) {
  file_->guarded([&] {
    while (!samples.empty()) {
      const std::size_t count = std::min(samples.size(), file_->tables.front().room());
      for (std::size_t i = 0; i < file_->tables.size(); ++i) {
        file_->columns[i]->pack(samples.first(count), file_->tables[i].end());
        file_->tables[i].advance(count);
      }
      file_->rows += count;
      samples = samples.subspan(count);
      if (file_->tables.front().room() > 0) continue;
      file_->write_samples();
      file_->claim_room();
    }
  });
}

void RecordingWriter::append(const StoredEvent& event) {
  file_->guarded([&] {
    Table& events = *file_->events;
    const std::vector<std::byte> row = event_row(event);
    std::copy(row.begin(), row.end(), events.end());
    events.advance(1);
    if (events.room() == 0) events.write();
  });
}

void RecordingWriter::flush() {
  file_->guarded([&] {
    file_->flush();
    file_->claim_room();
  });
}

void RecordingWriter::finish() {
  file_->guarded([&] {
    file_->flush();
    hdf5::update_attribute(file_->file.get(), "complete", true);
    checked(H5Fflush(file_->file.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
    if (!file_->close()) throw input_error("cannot be closed: " + hdf5::last_error());
  });
}

void RecordingWriter::abandon() noexcept {
  if (!file_ || !file_->file) return;
  try {
    flush();
    const hdf5::Silence silence;
    file_->close();
  } catch (const Error&) {
    // The disk refused the last rows; the file is closed with those before.
  }
}

std::uint64_t RecordingWriter::rows() const noexcept {
  return file_->rows;
}

}  // namespace haptrace
