#include "formats/disk_space.h"
#include "formats/hdf5_support.h"
#include "formats/output_file.h"
#include "formats/recording_layout.h"
#include "formats/recording_lock.h"
#include "formats/rfc3339.h"
#include "formats/sample_text.h"

#include <algorithm>
#include <boost/uuid/uuid_generators.hpp>
#include <boost/uuid/uuid_io.hpp>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using hdf5::checked;

constexpr std::size_t kEventsPerChunk = 64;
constexpr std::size_t kOverviewPerChunk = 64;
constexpr std::size_t kPlainRows = 2048;   // of a chunk as it lies in memory: costs at most 1.2 raw writes of its bytes
constexpr std::size_t kRowsInCache = 128;  // that go through all columns together
constexpr std::size_t kFilteredRows = 8192;  // of a chunk with filters

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

std::vector<std::byte> overview_row(const RecordingSummary& block) {
  std::vector<std::byte> row(512);
  std::size_t used = 0;
  for (const layout::OverviewField& field : layout::overview_fields()) {
    field.pack(block, row.data() + used);
    used += field.bytes();
  }
  row.resize(used);
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

/// The decimal digits that scale-offset must keep so that no error is larger than `bound`.
int digits_for(double bound) {
  return static_cast<int>(std::ceil(std::log10(0.5 / bound) + 1e-9));
}

/// Puts the filters of `storage` on a dataset and answers how many there are. Throws Error(input) like hdf5::checked.
unsigned add_filters(hid_t creation, const layout::Column& column, const Storage& storage) {
  unsigned filters = 0;
  if (column.quantity != nullptr && storage.precision.*column.quantity > 0) {
    checked(H5Pset_scaleoffset(creation, H5Z_SO_FLOAT_DSCALE, digits_for(storage.precision.*column.quantity)),
            column.path() + " cannot be rounded");
    ++filters;
  } else if (storage.deflate > 0 && layout::size_of(column.element) > 1 && column.quantity != &Precision::position) {
    // Positions lie on an encoder's counts, which deflate finds again whole; shuffled they are a third larger.
    checked(H5Pset_shuffle(creation), column.path() + " cannot be shuffled");
    ++filters;
  }
  if (storage.deflate > 0) {
    checked(H5Pset_deflate(creation, static_cast<unsigned>(storage.deflate)), column.path() + " cannot be compressed");
    ++filters;
  }
  return filters;
}

/// A dataset that grows by whole chunks. Without filters they go to the file as they lie in memory: past HDF5's
/// selections, its conversions and its chunk cache.
class Table {
 public:
  /// Of whatever type, without filters: the shape is [N].
  Table(hid_t file, const std::string& path, hid_t type, std::size_t rows_per_chunk, const char* units,
        const char* description, std::vector<std::byte> fill)
      : Table(path, 1, rows_per_chunk, std::move(fill)) {
    create(file, type, hdf5::Properties(H5Pcreate(H5P_DATASET_CREATE)), units, description);
  }

  /// A column of /samples, of the shape [N] or [N, width].
  Table(hid_t file, const layout::Column& column, std::size_t rows_per_chunk, const Storage& storage)
      : Table(column.path(), column.width, rows_per_chunk, fill_row(column)) {
    const hdf5::Properties creation(H5Pcreate(H5P_DATASET_CREATE));
    filters_ = add_filters(creation.get(), column, storage);
    type_ = hdf5::stored_type(column.element);
    if (column.quantity != nullptr && storage.precision.*column.quantity > 0)
      scale_ = std::pow(10.0, digits_for(storage.precision.*column.quantity));
    create(file, type_, creation, column.units, column.description);
  }

  [[nodiscard]] std::size_t room() const { return chunk_rows_ - used_; }
  [[nodiscard]] std::byte* end() { return buffer_.data() + used_ * fill_.size(); }

  /// `count` rows were put at end(); write() must follow when there is no more room.
  void advance(std::size_t count) {
    used_ += count;
    written_ = false;
  }

  /// A row was put at end().
  void advance_and_write_full() {
    advance(1);
    if (room() == 0) write();
  }

  /// Puts the present chunk into the file, whole, with fill values where it has no rows yet. With filters, a chunk that
  /// is not full is for the end only: written again, it would leave a hole of its former size in the file.
  void write() {
    if (written_) return;
    const hsize_t extent[] = {first_ + used_, width_}, offset[] = {first_, 0};
    checked(H5Dset_extent(dataset_.get(), extent), path_ + " cannot grow");
    if (filters_ > 0 && used_ == chunk_rows_ && fits_scale())
      write_filtered();
    else
      write_plain(offset);
    written_ = true;
    if (used_ == chunk_rows_) {
      first_ += used_;
      used_ = 0;
    }
  }

 private:
  Table(std::string path, std::size_t width, std::size_t rows_per_chunk, std::vector<std::byte> fill)
      : path_(std::move(path)),
        fill_(std::move(fill)),
        chunk_rows_(rows_per_chunk),
        rank_(width > 1 ? 2 : 1),
        width_(width) {
    buffer_.resize(fill_.size() * chunk_rows_);
  }

  void create(hid_t file, hid_t type, const hdf5::Properties& creation, const char* units, const char* description) {
    const hsize_t none[] = {0, width_}, unlimited[] = {H5S_UNLIMITED, width_}, chunk[] = {chunk_rows_, width_};
    const hdf5::Space space(H5Screate_simple(rank_, none, unlimited));
    H5Pset_chunk(creation.get(), rank_, chunk);
    // The fill value is one element: the first of a row, all of which are alike.
    H5Pset_fill_value(creation.get(), type, fill_.data());
    dataset_ = hdf5::Dataset(
        checked(H5Dcreate2(file, path_.c_str(), type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
                path_ + " cannot be created"));
    hdf5::create_attribute(dataset_.get(), "units", std::string(units));
    hdf5::create_attribute(dataset_.get(), "description", std::string(description));
  }

  void write_plain(const hsize_t* offset) {
    for (std::size_t row = used_; row < chunk_rows_; ++row)
      std::copy(fill_.begin(), fill_.end(), buffer_.begin() + static_cast<std::ptrdiff_t>(row * fill_.size()));
    const unsigned all_skipped = (1U << filters_) - 1;
    checked(H5Dwrite_chunk(dataset_.get(), H5P_DEFAULT, all_skipped, offset, buffer_.size(), buffer_.data()),
            path_ + " cannot be written");
  }

  void write_filtered() {
    const hsize_t start[] = {first_, 0}, count[] = {used_, width_};
    const hdf5::Space memory(H5Screate_simple(rank_, count, nullptr));
    const hdf5::Space disk(checked(H5Dget_space(dataset_.get()), path_ + " has no shape"));
    checked(H5Sselect_hyperslab(disk.get(), H5S_SELECT_SET, start, nullptr, count, nullptr),
            path_ + " cannot be selected");
    checked(H5Dwrite(dataset_.get(), type_, memory.get(), disk.get(), H5P_DEFAULT, buffer_.data()),
            path_ + " cannot be written");
  }

  /// Scale-offset turns v into round(v 10^D): what is not finite, or beyond what a double holds exactly, it garbles.
  [[nodiscard]] bool fits_scale() const {
    constexpr double kExact = 4503599627370496;  // 2^52
    if (scale_ == 0) return true;
    for (std::size_t at = 0; at < buffer_.size(); at += sizeof(double)) {
      double value = 0;
      std::memcpy(&value, buffer_.data() + at, sizeof value);
      if (!(std::abs(value) * scale_ < kExact)) return false;
    }
    return true;
  }

  std::string path_;
  hdf5::Dataset dataset_;
  std::vector<std::byte> buffer_;
  std::vector<std::byte> fill_;
  std::size_t chunk_rows_;
  int rank_;
  hsize_t width_;
  hid_t type_ = H5I_INVALID_HID;
  unsigned filters_ = 0;
  double scale_ = 0;      ///< of the scale-offset filter; 0: none
  hsize_t first_ = 0;     ///< row of the file where the buffer begins
  std::size_t used_ = 0;  ///< rows in the buffer
  bool written_ = true;   ///< the file has all of the buffer's rows
};

void check_length(const std::string& name, std::size_t bytes) {
  if (bytes > layout::kLongestText)
    throw input_error(
        fmt::format("{} has {} bytes; a recording keeps at most {}: shorten it", name, bytes, layout::kLongestText));
}

void check_texts(const RecordingHeader& header) {
  for (const layout::Attribute& attribute : layout::attributes()) {
    std::size_t bytes = 0;
    if (const auto* text = std::get_if<std::string RecordingHeader::*>(&attribute.member))
      bytes = (header.**text).size();
    if (const auto* json = std::get_if<nlohmann::json RecordingHeader::*>(&attribute.member))
      bytes = dump(header.**json).size();
    check_length(attribute.name, bytes);
  }
  for (const auto& [key, value] : header.meta) {
    if (key.empty() || key.size() > 200)
      throw input_error(fmt::format("a key of the metadata has {} bytes; it must have 1 to 200", key.size()));
    check_length(key, value.size());
  }
}

void create_attributes(hid_t file, const RecordingHeader& header) {
  hdf5::create_attribute(file, "format", std::string(layout::kFormat));
  for (const layout::Attribute& attribute : layout::attributes()) {
    if (attribute.of_parts && header.part == 0) continue;
    std::visit(
        [&](auto member) {
          if (std::string_view(attribute.name) == layout::kWarnings)
            hdf5::create_attribute(file, attribute.name, layout::warnings_text(header.warnings), layout::kWarningBytes);
          else if constexpr (std::is_same_v<decltype(member), nlohmann::json RecordingHeader::*>)
            hdf5::create_attribute(file, attribute.name, dump(header.*member));
          else
            hdf5::create_attribute(file, attribute.name, header.*member);
        },
        attribute.member);
  }
  if (header.meta.empty()) return;
  const hdf5::Properties creation(H5Pcreate(H5P_GROUP_CREATE));
  H5Pset_attr_phase_change(creation.get(), 64, 0);
  const hdf5::Group meta(
      checked(H5Gcreate2(file, layout::kMeta, H5P_DEFAULT, creation.get(), H5P_DEFAULT), layout::kMeta));
  for (const auto& [key, value] : header.meta) hdf5::create_attribute(meta.get(), key.c_str(), value);
}

/// In the place of an empty file.
hdf5::File create_file(const std::string& file, bool for_hdf5_1_8) {
  const hdf5::Properties creation(H5Pcreate(H5P_FILE_CREATE)), access(H5Pcreate(H5P_FILE_ACCESS));
  // Attributes in the object header have fixed places, so that `complete` may change while others read.
  H5Pset_attr_phase_change(creation.get(), 64, 0);
  const H5F_libver_t version = for_hdf5_1_8 ? H5F_LIBVER_V18 : H5F_LIBVER_V110;
  H5Pset_libver_bounds(access.get(), version, version);
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  const hid_t id = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, creation.get(), access.get());
  if (id < 0) throw input_error("cannot be created: " + hdf5::last_error());
  return hdf5::File(id);
}

/// Where to put a recording whose file was removed: its own name if that is free, else a name beside it, in the nearest
/// folder that is still there.
fs::path rescue_path(const fs::path& file) {
  std::error_code error;
  fs::path folder = fs::absolute(file, error).parent_path();
  while (!fs::is_directory(folder, error) && folder.has_relative_path()) folder = folder.parent_path();
  fs::path rescued = folder / file.filename();
  for (int i = 1; fs::exists(fs::symlink_status(rescued, error)); ++i)
    rescued = folder / fmt::format("{}.rescued{}{}", file.stem().string(), i, file.extension().string());
  return rescued;
}

/// Copies a file that has no name any more. Throws Error(fault): that it was removed, and what became of it.
void rescue(int descriptor, const std::string& name) {
  std::error_code error;
  const fs::path rescued = rescue_path(name);
  fs::copy_file(fmt::format("/proc/self/fd/{}", descriptor), rescued, error);
  throw Error(Error::Kind::fault,
              error ? fmt::format("{}: was removed while it was written, and could not be kept as {}: {}", name,
                                  rescued.string(), error.message())
                    : fmt::format("{}: was removed while it was written; the recording was kept as {}", name,
                                  rescued.string()));
}

}  // namespace

std::string part_file(const std::string& file, std::uint32_t part) {
  if (part <= 1) return file;
  fs::path path(file);
  const std::string ending = path.extension().string();
  return path.replace_extension(fmt::format(".part{:03}{}", part, ending)).string();
}

/// One file that is being written.
class RecordingWriter::File {
 public:
  File(const std::string& name, const RecordingHeader& header, const RecordingColumns& columns, const Options& options)
      : name_(name), filtered_(options.storage.filtered()) {
    const hdf5::Silence silence;
    OutputFile output(name, options.overwrite);
    output.create();
    try {
      if (const std::string refusal = Reserve::process_limit(Reserve::kBookkeeping); !refusal.empty())
        throw input_error(refusal);
      file_ = create_file(output.path(), options.for_hdf5_1_8);
      create(header, columns, options);
    } catch (const Error& error) {
      close_broken();
      throw input_error(fmt::format("{}: {}", name, error.what()));
    }
    output.commit_without_waiting();
  }

  /// Runs something that writes. After its first failure nothing is written any more.
  template <class Action>
  void guarded(const Action& action) {
    if (!failure_.empty()) throw Error(Error::Kind::fault, failure_);
    if (!file_) throw Error(Error::Kind::fault, name_ + ": the recording is closed already");
    const hdf5::Silence silence;
    try {
      action();
    } catch (const Error& error) {
      failure_ = error.kind() == Error::Kind::fault
                     ? error.what()
                     : fmt::format("{}: recording stopped after {} samples: {}", name_, rows_, error.what());
      close_broken();
      throw Error(Error::Kind::fault, failure_);
    }
  }

  void append(std::span<const Sample> samples) {
    while (!samples.empty()) {
      const std::size_t count = std::min({samples.size(), kRowsInCache, tables_.front().room(),
                                          static_cast<std::size_t>(layout::kOverviewRows - summariser_.rows())});
      for (std::size_t i = 0; i < tables_.size(); ++i) {
        columns_[i]->pack(samples.first(count), tables_[i].end());
        tables_[i].advance(count);
      }
      summariser_.add(samples.first(count));
      rows_ += count;
      samples = samples.subspan(count);
      if (summariser_.rows() == layout::kOverviewRows) append_overview();
      if (tables_.front().room() > 0) continue;
      write_samples();
      claim_room();
    }
  }

  void append(const StoredEvent& event) {
    const std::vector<std::byte> row = event_row(event);
    std::copy(row.begin(), row.end(), events_->end());
    events_->advance_and_write_full();
  }

  void flush() {
    if (!filtered_) write_samples();
    write_rest();
    claim_room();
  }

  void sync() {
    flush();
    while (fdatasync(reserve_->descriptor()) != 0)
      if (errno != EINTR) throw input_error(fmt::format("cannot be forced to the disk: {}", std::strerror(errno)));
  }

  void warn(const nlohmann::json& warnings) {
    hdf5::update_attribute(file_.get(), layout::kWarnings, layout::warnings_text(warnings));
  }

  void finish() {
    write_all();
    hdf5::update_attribute(file_.get(), "complete", true);
    checked(H5Fflush(file_.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
    close();
  }

  /// Closes as it is. Throws what guarded() does.
  void leave() {
    write_all();
    close();
  }

  [[nodiscard]] bool open() const noexcept { return static_cast<bool>(file_); }
  [[nodiscard]] std::uint64_t rows() const noexcept { return rows_; }
  [[nodiscard]] const std::string& name() const noexcept { return name_; }

  [[nodiscard]] std::uint64_t bytes() const {
    hsize_t bytes = 0;
    if (file_) H5Fget_filesize(file_.get(), &bytes);
    return bytes;
  }

  [[nodiscard]] std::string misplaced() const {
    struct stat ours {
    }, named{};
    if (!reserve_ || fstat(reserve_->descriptor(), &ours) != 0) return {};
    if (stat(name_.c_str(), &named) == 0 && named.st_ino == ours.st_ino && named.st_dev == ours.st_dev) return {};
    if (ours.st_nlink == 0)
      return fmt::format("{}: was removed while it is being written; it will be kept as {} when it ends", name_,
                         rescue_path(name_).string());
    std::error_code error;
    const fs::path now = fs::read_symlink(fmt::format("/proc/self/fd/{}", reserve_->descriptor()), error);
    return fmt::format("{}: was moved while it is being written; it is now {}", name_, now.string());
  }

 private:
  /// Time comes last: a row that has a time has everything, whatever happens in between.
  void write_samples() {
    for (auto table = tables_.rbegin(); table != tables_.rend(); ++table) table->write();
  }

  void write_rest() {
    events_->write();
    overview_->write();
    checked(H5Fflush(file_.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
  }

  void write_all() {
    if (summariser_.rows() > 0) append_overview();
    write_samples();
    write_rest();
  }

  void append_overview() {
    const std::vector<std::byte> row = overview_row(summariser_.take());
    std::copy(row.begin(), row.end(), overview_->end());
    overview_->advance_and_write_full();
  }

  /// Throws when the disk has no room for what may come next; everything so far is then in the file, which is closed.
  void claim_room() {
    const std::string refusal = reserve_->claim(bytes());
    if (refusal.empty()) return;
    leave();
    throw input_error(refusal);
  }

  void close() {
    tables_.clear();
    events_.reset();
    overview_.reset();
    if (!file_.close()) throw input_error("cannot be closed: " + hdf5::last_error());
    struct stat status {};
    if (fstat(reserve_->descriptor(), &status) == 0 && status.st_nlink == 0) rescue(reserve_->descriptor(), name_);
    reserve_.reset();
  }

  /// Closes a file that cannot be written any more. HDF5 would try, fail half-way with a superblock that nobody can
  /// read, and crash at the end of the program: so what it still wants to write goes nowhere, and the file stays as the
  /// last flush left it.
  void close_broken() noexcept {
    void* descriptor = nullptr;
    const int nowhere = memfd_create("haptrace", MFD_CLOEXEC);
    if (file_ && nowhere >= 0 && H5Fget_vfd_handle(file_.get(), H5P_DEFAULT, &descriptor) >= 0)
      dup2(nowhere, *static_cast<int*>(descriptor));
    if (nowhere >= 0) ::close(nowhere);
    tables_.clear();
    events_.reset();
    overview_.reset();
    file_.close();
    reserve_.reset();
  }

  void create(const RecordingHeader& header, const RecordingColumns& chosen, const Options& options) {
    create_attributes(file_.get(), header);
    const hdf5::Group samples(
        checked(H5Gcreate2(file_.get(), "/samples", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "/samples"));
    std::size_t rows_per_chunk = options.storage.rows_per_chunk;
    if (rows_per_chunk == 0) rows_per_chunk = filtered_ ? kFilteredRows : kPlainRows;
    std::uint64_t chunk_bytes = 0;
    for (const layout::Column& column : layout::columns()) {
      if (!column.in(chosen)) continue;
      columns_.push_back(&column);
      tables_.emplace_back(file_.get(), column, rows_per_chunk, options.storage);
      chunk_bytes += rows_per_chunk * column.row_bytes();
    }
    events_.emplace(file_.get(), layout::kEvents, hdf5::event_type().get(), kEventsPerChunk, layout::kEventUnits,
                    layout::kEventDescription, event_row({kNaN, 0, ""}));
    overview_.emplace(file_.get(), layout::kOverview, hdf5::overview_type().get(), kOverviewPerChunk,
                      layout::kOverviewUnits, layout::kOverviewDescription, overview_row({}));

    void* descriptor = nullptr;
    checked(H5Fget_vfd_handle(file_.get(), H5P_DEFAULT, &descriptor), "has no descriptor");
    reserve_.emplace(*static_cast<int*>(descriptor), chunk_bytes);
    if (const std::string refusal = reserve_->claim(0); !refusal.empty()) throw input_error(refusal);
    mark_as_writer(reserve_->descriptor());
    if (!options.for_hdf5_1_8) checked(H5Fstart_swmr_write(file_.get()), "cannot be opened to live readers");
  }

  std::string name_;
  bool filtered_;
  hdf5::File file_;
  std::optional<Reserve> reserve_;
  std::vector<const layout::Column*> columns_;
  std::vector<Table> tables_;  ///< one per column
  std::optional<Table> events_, overview_;
  Summariser summariser_;  ///< of the rows that /overview does not have yet
  std::uint64_t rows_ = 0;
  std::string failure_;  ///< why writing stopped; empty while it goes on
};

RecordingWriter::RecordingWriter(const std::string& file, const RecordingHeader& header,
                                 const RecordingColumns& columns, const Options& options)
    : header_(header), columns_(columns), options_(options), name_(file) {
  validate(options.storage);
  if (header_.uuid.empty()) header_.uuid = boost::uuids::to_string(boost::uuids::random_generator()());
  if (header_.created.empty()) header_.created = rfc3339(std::chrono::system_clock::now());
  header_.complete = false;
  if (!options.keep_part) {
    header_.part = 0;
    header_.part_of.clear();
  }
  if (options.in_parts) {
    header_.part = 1;
    header_.part_of = header_.uuid;
    const std::string second = part_file(file, 2);
    if (!options.overwrite && fs::exists(second))
      throw input_error(
          fmt::format("{}: exists already and would be part 2 of {}; choose another name or allow it to "
                      "be replaced (--overwrite)",
                      second, file));
  }
  try {
    check_texts(header_);
  } catch (const Error& error) {
    throw input_error(fmt::format("{}: {}", file, error.what()));
  }
  file_ = std::make_unique<File>(file, header_, columns_, options_);
}

RecordingWriter::~RecordingWriter() {
  abandon();
}

RecordingWriter::RecordingWriter(RecordingWriter&&) noexcept = default;

RecordingWriter& RecordingWriter::operator=(RecordingWriter&& other) noexcept {
  if (this != &other) {
    abandon();
    header_ = std::move(other.header_);
    columns_ = other.columns_;
    options_ = other.options_;
    name_ = std::move(other.name_);
    rows_before_ = other.rows_before_;
    file_ = std::move(other.file_);
  }
  return *this;
}

void RecordingWriter::append(std::span<const Sample> samples) {
  file_->guarded([&] { file_->append(samples); });
}

void RecordingWriter::append(const StoredEvent& event) {
  file_->guarded([&] { file_->append(event); });
}

void RecordingWriter::flush() {
  file_->guarded([&] { file_->flush(); });
}

void RecordingWriter::sync() {
  file_->guarded([&] { file_->sync(); });
}

void RecordingWriter::start_part() {
  if (!options_.in_parts) throw input_error(name_ + ": was not begun as a recording in parts");
  finish();
  rows_before_ += file_->rows();
  ++header_.part;
  header_.uuid = boost::uuids::to_string(boost::uuids::random_generator()());
  try {
    file_ = std::make_unique<File>(part_file(name_, header_.part), header_, columns_, options_);
  } catch (const Error& error) {
    throw Error(Error::Kind::fault, fmt::format("the recording ends with part {}: {}", header_.part - 1, error.what()));
  }
}

void RecordingWriter::warn(const nlohmann::json& warnings) {
  file_->guarded([&] { file_->warn(warnings); });
}

void RecordingWriter::finish() {
  file_->guarded([&] { file_->finish(); });
}

void RecordingWriter::abandon() noexcept {
  if (!file_ || !file_->open()) return;
  try {
    file_->guarded([&] { file_->leave(); });
  } catch (const Error&) {
    // The disk refused the last rows; the file is closed with those before.
  }
}

std::uint64_t RecordingWriter::rows() const noexcept {
  return rows_before_ + file_->rows();
}

std::uint64_t RecordingWriter::part_rows() const noexcept {
  return file_->rows();
}

std::uint64_t RecordingWriter::part_bytes() const {
  return file_->bytes();
}

const std::string& RecordingWriter::part() const noexcept {
  return file_->name();
}

std::string RecordingWriter::misplaced() const {
  return file_->misplaced();
}

}  // namespace haptrace
