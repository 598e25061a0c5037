#include "base/disk_space.h"
#include "base/output_file.h"
#include "base/printable.h"
#include "base/rfc3339.h"
#include "base/writer_mark.h"
#include "formats/convert/sample_text.h"
#include "formats/recording/hdf5_support.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <array>
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
constexpr std::size_t kChecksumsPerChunk = 64;
constexpr std::size_t kClocksPerChunk = 64;
constexpr std::size_t kPlainRows = 2048;     // per unfiltered chunk: costs at most 1.2 raw writes of its bytes
constexpr std::size_t kRowsInCache = 128;    // that pass through all columns together
constexpr std::size_t kFilteredRows = 8192;  // per filtered chunk
constexpr hsize_t kPage = 4096;              // memory page [bytes], on all machines that we know

/// Returns one row of fill values.
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

/// Returns the fill value of /contacts.
std::vector<std::byte> no_contact() {
  const auto row = layout::pack({.depth = kNaN, .force = nan3()});
  std::vector<std::byte> fill(row.begin(), row.end());
  std::memcpy(fill.data() + layout::ContactRow::kTime, &kNaN, sizeof kNaN);
  return fill;
}

std::vector<std::byte> event_row(const StoredEvent& event) {
  std::vector<std::byte> row(layout::EventRow::kBytes);
  std::memcpy(row.data() + layout::EventRow::kTime, &event.time, sizeof event.time);
  std::memcpy(row.data() + layout::EventRow::kCode, &event.code, sizeof event.code);
  constexpr std::string_view kCut = "...";
  const std::string whole = utf8_text(event.text);
  const bool cut = whole.size() > kLongestEventText;
  std::string text(utf8_prefix(whole, kLongestEventText - (cut ? kCut.size() : 0)));
  if (cut) text += kCut;
  std::memcpy(row.data() + layout::EventRow::kText, text.data(), text.size());
  return row;
}

/// Adds the filters of `storage` to a dataset. Returns their number. Throws Error(input) like hdf5::checked.
unsigned add_filters(hid_t creation, const layout::Column& column, const Storage& storage) {
  unsigned filters = 0;
  if (column.quantity != nullptr && storage.precision.*column.quantity > 0) {
    checked(H5Pset_scaleoffset(creation, H5Z_SO_FLOAT_DSCALE,
                               layout::DecimalGrid::within(storage.precision.*column.quantity).digits()),
            column.path() + " cannot be rounded");
    ++filters;
  } else if (storage.deflate > 0 && layout::size_of(column.element) > 1 && column.quantity != &Precision::position) {
    // Positions are whole encoder counts, which deflate finds again as a whole; shuffled they are a third larger.
    checked(H5Pset_shuffle(creation), column.path() + " cannot be shuffled");
    ++filters;
  }
  if (storage.deflate > 0) {
    checked(H5Pset_deflate(creation, static_cast<unsigned>(storage.deflate)), column.path() + " cannot be compressed");
    ++filters;
  }
  return filters;
}

/// A dataset that grows by whole chunks. Unfiltered chunks go to the file as they are in memory, and bypass HDF5's
/// selections, conversions and chunk cache. The last rows stay in memory, including those already in the file.
class Table {
 public:
  /// Creates an unfiltered dataset of any type, of the shape [N] or [N, width].
  Table(hid_t file, const std::string& path, hid_t type, std::size_t width, std::size_t rows_per_chunk,
        const char* units, const char* description, std::vector<std::byte> fill)
      : Table(path, width, rows_per_chunk, std::move(fill)) {
    create(file, type, hdf5::Properties(H5Pcreate(H5P_DATASET_CREATE)), units, description);
  }

  /// Creates a column of /samples, of the shape [N] or [N, width].
  Table(hid_t file, const layout::Column& column, std::size_t rows_per_chunk, const Storage& storage)
      : Table(column.path(), column.width, rows_per_chunk, fill_row(column)) {
    const hdf5::Properties creation(H5Pcreate(H5P_DATASET_CREATE));
    filters_ = add_filters(creation.get(), column, storage);
    type_ = hdf5::stored_type(column.element);
    if (column.quantity != nullptr && storage.precision.*column.quantity > 0)
      grid_ = layout::DecimalGrid::within(storage.precision.*column.quantity);
    create(file, type_, creation, column.units, column.description);
  }

  [[nodiscard]] hid_t dataset() const { return dataset_.get(); }
  void release() { dataset_ = hdf5::Dataset(); }  ///< the rows in memory stay
  void open_again(hid_t file) {
    dataset_ = hdf5::Dataset(checked(H5Dopen2(file, path_.c_str(), H5P_DEFAULT), path_ + " cannot be opened"));
  }

  [[nodiscard]] std::size_t room() const { return chunk_rows_ - used_; }
  [[nodiscard]] std::byte* end() { return buffer_.data() + used_ * fill_.size(); }

  /// Rounds `count` rows at end(). Returns false if the column is not rounded.
  bool round(std::size_t count) {
    if (grid_) grid_->snap({end(), count * fill_.size()});
    return grid_.has_value();
  }

  /// Adds `count` rows that were put at end(). Call write() next if there is no more room.
  void advance(std::size_t count) {
    used_ += count;
    written_ = false;
  }

  void append_and_write_full(std::span<const std::byte> row) {
    std::copy(row.begin(), row.end(), end());
    advance(1);
    if (room() == 0) write();
  }

  /// Returns the rows of the present chunk, as they are in memory.
  [[nodiscard]] std::span<const std::byte> chunk() const { return {buffer_.data(), used_ * fill_.size()}; }

  [[nodiscard]] hsize_t rows() const { return first_ + used_; }
  [[nodiscard]] hsize_t rows_written() const { return written_ ? rows() : first_; }
  [[nodiscard]] hsize_t first_held() const { return first_ - held_before_; }

  /// Returns row `row`, which must be from first_held() to rows().
  [[nodiscard]] const std::byte* held(hsize_t row) const {
    return row >= first_ ? buffer_.data() + (row - first_) * fill_.size()
                         : previous_.data() + (row - first_held()) * fill_.size();
  }

  /// Returns the most that the file can grow by for `more` rows [bytes].
  [[nodiscard]] std::uint64_t growth(std::uint64_t more) const {
    constexpr std::uint64_t kOfChunk = 256;  // for the index, and the largest overhead of a filter
    const std::uint64_t chunks = (used_ + more + chunk_rows_ - 1) / chunk_rows_;
    return (chunks - (in_file_ && chunks > 0 ? 1 : 0)) * (buffer_.size() + buffer_.size() / 1024 + kOfChunk);
  }

  /// Writes the whole present chunk to the file, with fill values for rows that it does not have yet. A filtered chunk
  /// that is not full may only be written at the end: written again, it would leave a hole of its former size in the
  /// file.
  void write() {
    if (written_) return;
    const hsize_t extent[] = {first_ + used_, width_}, offset[] = {first_, 0};
    checked(H5Dset_extent(dataset_.get(), extent), path_ + " cannot grow");
    if (filters_ > 0 && used_ == chunk_rows_ && fits_grid())
      write_filtered();
    else
      write_plain(offset);
    written_ = in_file_ = true;
    if (used_ < chunk_rows_) return;
    first_ += used_;
    held_before_ = std::exchange(used_, 0);
    in_file_ = false;
    previous_.resize(buffer_.size());
    std::swap(previous_, buffer_);
    clear_room();
  }

 private:
  Table(std::string path, std::size_t width, std::size_t rows_per_chunk, std::vector<std::byte> fill)
      : path_(std::move(path)),
        fill_(std::move(fill)),
        chunk_rows_(rows_per_chunk),
        rank_(width > 1 ? 2 : 1),
        width_(width) {
    buffer_.resize(fill_.size() * chunk_rows_);
    clear_room();
  }

  /// Fills the buffer with fill values for future rows.
  void clear_room() {
    for (std::size_t row = 0; row < chunk_rows_; ++row)
      std::copy(fill_.begin(), fill_.end(), buffer_.begin() + static_cast<std::ptrdiff_t>(row * fill_.size()));
  }

  void create(hid_t file, hid_t type, const hdf5::Properties& creation, const char* units, const char* description) {
    const hsize_t none[] = {0, width_}, unlimited[] = {H5S_UNLIMITED, width_}, chunk[] = {chunk_rows_, width_};
    const hdf5::Space space(H5Screate_simple(rank_, none, unlimited));
    H5Pset_chunk(creation.get(), rank_, chunk);
    // The fill value is one element. All elements of a row are alike, so the first one serves.
    H5Pset_fill_value(creation.get(), type, fill_.data());
    dataset_ = hdf5::Dataset(
        checked(H5Dcreate2(file, path_.c_str(), type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
                path_ + " cannot be created"));
    hdf5::create_attribute(dataset_.get(), "units", std::string(units));
    hdf5::create_attribute(dataset_.get(), "description", std::string(description));
  }

  void write_plain(const hsize_t* offset) {
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

  /// Returns false if the scale-offset filter cannot hold all values: it would corrupt some.
  [[nodiscard]] bool fits_grid() const {
    if (!grid_) return true;
    for (std::size_t at = 0; at < buffer_.size(); at += sizeof(double)) {
      double value = 0;
      std::memcpy(&value, buffer_.data() + at, sizeof value);
      if (!grid_->holds(value)) return false;
    }
    return true;
  }

  std::string path_;
  hdf5::Dataset dataset_;
  std::vector<std::byte> buffer_, previous_;  ///< rows from first_ on, then fill values; rows before them
  std::vector<std::byte> fill_;
  std::size_t chunk_rows_;
  int rank_;
  hsize_t width_;
  hid_t type_ = H5I_INVALID_HID;
  unsigned filters_ = 0;
  std::optional<layout::DecimalGrid> grid_;  ///< of the scale-offset filter
  hsize_t first_ = 0;                        ///< row of the file at the start of the buffer
  std::size_t used_ = 0;                     ///< rows in the buffer
  std::size_t held_before_ = 0;              ///< rows in previous_
  bool written_ = true;                      ///< the file has all rows of the buffer
  bool in_file_ = false;                     ///< the file has a place for the buffer
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

/// Converts the header's texts to UTF-8: those of files and devices may be in any encoding. JSON is converted when it
/// is written.
void make_utf8(RecordingHeader& header) {
  for (const layout::Attribute& attribute : layout::attributes())
    if (const auto* text = std::get_if<std::string RecordingHeader::*>(&attribute.member))
      header.** text = utf8_text(header.**text);
  std::map<std::string, std::string> meta;
  for (const auto& [key, value] : header.meta) meta[utf8_text(key)] = utf8_text(value);
  header.meta = std::move(meta);
  header.scene.text = utf8_text(header.scene.text);
  header.scene.folder = utf8_text(header.scene.folder);
  for (std::string& name : header.scene.objects) name = utf8_text(name);
}

/// Attributes of any size have their place outside the group's header.
void create_scene(hid_t file, const RecordedScene& scene) {
  if (scene.empty()) return;
  const hdf5::Properties creation(H5Pcreate(H5P_GROUP_CREATE));
  H5Pset_attr_phase_change(creation.get(), 0, 0);
  const hdf5::Group group(
      checked(H5Gcreate2(file, layout::kScene, H5P_DEFAULT, creation.get(), H5P_DEFAULT), layout::kScene));
  hdf5::create_attribute(group.get(), layout::kSceneText, scene.text);
  hdf5::create_attribute(group.get(), layout::kSceneObjects, dump(nlohmann::json(scene.objects)));
  if (!scene.folder.empty()) hdf5::create_attribute(group.get(), layout::kSceneFolder, scene.folder);
  for (const auto& [name, hash] : scene.files)
    hdf5::create_attribute(group.get(), (layout::kSceneFile + name).c_str(), hash);
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
  create_scene(file, header.scene);
  if (header.meta.empty()) return;
  const hdf5::Properties creation(H5Pcreate(H5P_GROUP_CREATE));
  H5Pset_attr_phase_change(creation.get(), 64, 0);
  const hdf5::Group meta(
      checked(H5Gcreate2(file, layout::kMeta, H5P_DEFAULT, creation.get(), H5P_DEFAULT), layout::kMeta));
  for (const auto& [key, value] : header.meta) hdf5::create_attribute(meta.get(), key.c_str(), value);
}

/// Creates a file in place of an empty one. `in_pages`: nothing shorter than a page crosses a page boundary.
hdf5::File create_file(const std::string& file, bool for_hdf5_1_8, bool in_pages) {
  const hdf5::Properties creation(H5Pcreate(H5P_FILE_CREATE)), access(H5Pcreate(H5P_FILE_ACCESS));
  // Attributes in the object header have fixed places, so that `complete` can change while others read.
  H5Pset_attr_phase_change(creation.get(), 64, 0);
  if (in_pages) {
    // The kernel copies a write page by page, and SIGKILL can end it between two pages. An index node on two pages
    // would then be half old and half new, and its checksum would be wrong.
    H5Pset_file_space_strategy(creation.get(), H5F_FSPACE_STRATEGY_PAGE, /*persist=*/false, /*threshold=*/1);
    H5Pset_file_space_page_size(creation.get(), kPage);
  }
  const H5F_libver_t version = for_hdf5_1_8 ? H5F_LIBVER_V18 : H5F_LIBVER_V110;
  H5Pset_libver_bounds(access.get(), version, version);
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  const hid_t id = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, creation.get(), access.get());
  if (id < 0) throw input_error("cannot be created: " + hdf5::last_error());
  return hdf5::File(id);
}

/// Returns a path for a recording whose file was removed: its own name if that is free, otherwise a name beside it, in
/// the nearest folder that still exists.
fs::path rescue_path(const fs::path& file) {
  std::error_code error;
  fs::path folder = fs::absolute(file, error).parent_path();
  while (!fs::is_directory(folder, error) && folder.has_relative_path()) folder = folder.parent_path();
  fs::path rescued = folder / file.filename();
  for (int i = 1; fs::exists(fs::symlink_status(rescued, error)); ++i)
    rescued = folder / fmt::format("{}.rescued{}{}", file.stem().string(), i, file.extension().string());
  return rescued;
}

/// Copies a file that has lost its name. Throws Error(fault), which reports the removal and the place of the copy.
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
      file_ = create_file(output.path(), options.for_hdf5_1_8, in_pages(options));
      create(header, columns, options);
      if (!options.for_hdf5_1_8) open_to_readers(output.path());
      begin(header.uuid);
    } catch (const Error& error) {
      close_broken();
      throw input_error(fmt::format("{}: {}", name, error.what()));
    }
    output.commit_without_waiting();
  }

  /// Runs an action that writes. After its first failure nothing is written any more.
  template <class Action>
  void guarded(const Action& action) {
    if (!failure_.empty()) throw Error(Error::Kind::fault, failure_);
    if (!file_) throw Error(Error::Kind::fault, name_ + ": the recording is closed already");
    const hdf5::Silence silence;
    try {
      action();
    } catch (const Error& error) {
      if (file_) close_broken();
      kept_elsewhere_ = error.kind() == Error::Kind::fault;
      in_file_ = kept_elsewhere_ ? all() : content().value_or(in_file_);
      fail(kept_elsewhere_
               ? error.what()
               : fmt::format("{}: recording stopped after {} samples: {}", name_, in_file_.rows, error.what()));
      throw Error(Error::Kind::fault, failure_);
    }
  }

  /// Sets the reason for which nothing is written any more.
  void fail(std::string why) { failure_ = std::move(why); }

  void append(std::span<const Sample> samples) {
    try {
      put_all(samples);
    } catch (const Error&) {
      waiting_.assign(samples.begin(), samples.end());
      throw;
    }
  }

  /// Puts `samples` into the tables, and removes from them those that were put.
  void put_all(std::span<const Sample>& samples) {
    while (!samples.empty()) {
      const std::size_t count = std::min({samples.size(), kRowsInCache, tables_.front().room(),
                                          static_cast<std::size_t>(layout::kOverviewRows - summariser_.rows())});
      summariser_.add(put(samples.first(count)));
      last_time_ = 1e-9 * static_cast<double>(samples[count - 1].time_ns);
      rows_ += count;
      samples = samples.subspan(count);
      if (summariser_.rows() == layout::kOverviewRows) append_overview();
      if (tables_.front().room() > 0) continue;
      write_samples();
      claim_room();
    }
  }

  void append(const StoredEvent& event) { append_event(event_row(event)); }

  void append(std::span<const ContactSample> contacts) {
    if (!contacts_) return;
    for (const ContactSample& contact : contacts) append_contact(layout::pack(contact));
  }

  void append(const ClockReading& reading) {
    const layout::ClockRow row = layout::pack(reading);
    clocks_->append_and_write_full(std::as_bytes(std::span(row)));
  }

  void flush() {
    if (!filtered_) write_samples();
    write_rest();
    in_file_ = all();
    in_file_.rows = tables_.front().rows_written();
    claim_room();
  }

  void sync() {
    flush();
    while (fdatasync(reserve_->descriptor()) != 0)
      if (errno != EINTR) throw input_error(fmt::format("cannot be synced to the disk: {}", std::strerror(errno)));
  }

  void warn(const nlohmann::json& warnings) {
    hdf5::update_attribute(file_.get(), layout::kWarnings, layout::warnings_text(warnings));
  }

  /// `continued`: a further part was started.
  void finish(bool continued) {
    write_all();
    if (continued) hdf5::update_attribute(file_.get(), layout::kContinued, true);
    hdf5::update_attribute(file_.get(), "complete", true);
    checked(H5Fflush(file_.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
    close();
  }

  /// Closes the file without marking it complete. Throws like guarded().
  void leave() {
    write_all();
    close();
  }

  /// Takes over the rows that `broken` has in memory but not in its file. Returns how many of its rows are in neither.
  std::uint64_t take_over(File& broken) {
    broken.in_file_ = broken.content().value_or(Content{});
    const std::uint64_t first = std::max(broken.in_file_.rows, broken.first_held());
    append(broken.held(first));
    const Table& events = *broken.events_;
    for (hsize_t row = std::max<hsize_t>(broken.in_file_.events, events.first_held()); row < events.rows(); ++row)
      append_event({events.held(row), layout::EventRow::kBytes});
    if (contacts_ && broken.contacts_) {
      const Table& contacts = *broken.contacts_;
      for (hsize_t row = std::max<hsize_t>(broken.in_file_.contacts, contacts.first_held()); row < contacts.rows();
           ++row)
        append_contact({contacts.held(row), layout::ContactRow::kBytes});
    }
    flush();
    return first - broken.in_file_.rows;
  }

  [[nodiscard]] bool open() const noexcept { return static_cast<bool>(file_); }
  [[nodiscard]] bool failed() const noexcept { return !failure_.empty(); }
  [[nodiscard]] bool kept_elsewhere() const noexcept { return kept_elsewhere_; }
  [[nodiscard]] std::uint64_t rows() const noexcept { return failed() ? in_file_.rows : rows_; }
  [[nodiscard]] const std::string& name() const noexcept { return name_; }

  [[nodiscard]] std::uint64_t bytes(std::size_t more) const {
    std::uint64_t bytes = size() + kIndexes;
    for (const Table& table : tables_) bytes += table.growth(more);
    bytes += events_->growth(kEventsPerChunk) + clocks_->growth(1);
    if (contacts_) bytes += contacts_->growth(more);
    for (const Table& table : event_list_) bytes += table.growth(kEventsPerChunk);
    bytes += overview_->growth(more / layout::kOverviewRows + 2);
    return bytes + checksums_->growth(more / rows_per_chunk_ + 2);
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
  /// Small filtered chunks would waste half a page each. Only conversions use them, and these are not read
  /// half-written.
  [[nodiscard]] static bool in_pages(const Options& options) {
    const std::size_t rows = options.storage.rows_per_chunk;
    return !options.for_hdf5_1_8 && (!options.storage.filtered() || rows == 0 || rows >= kFilteredRows);
  }

  static constexpr std::uint64_t kIndexes = 64U << 10U;  ///< largest growth of HDF5's indexes of the datasets [bytes]

  [[nodiscard]] std::uint64_t size() const {
    hsize_t bytes = 0;
    if (file_) H5Fget_filesize(file_.get(), &bytes);
    return bytes;
  }

  struct Content {
    std::uint64_t rows = 0, events = 0, contacts = 0;
  };

  /// Returns what was appended.
  [[nodiscard]] Content all() const { return {rows_, events_->rows(), contacts_ ? contacts_->rows() : 0}; }

  /// Returns the content of the file on the disk, as readers see it now; nothing if it cannot be read, and no rows if
  /// another file has its name.
  [[nodiscard]] std::optional<Content> content() const noexcept {
    try {
      const RecordingReader reader(name_, RecordingReader::Parts::this_file);
      if (reader.header().uuid != uuid_) return Content{};
      return Content{reader.rows(), reader.events().size(), reader.contact_rows()};
    } catch (const std::exception&) {
      return std::nullopt;
    }
  }

  /// Returns the first row that is in memory for all columns.
  [[nodiscard]] std::uint64_t first_held() const {
    std::uint64_t first = 0;
    for (const Table& table : tables_) first = std::max<std::uint64_t>(first, table.first_held());
    return first;
  }

  /// Returns the rows from `first` on, which must be in memory, and those in waiting_.
  [[nodiscard]] std::vector<Sample> held(std::uint64_t first) const {
    std::vector<Sample> samples(rows_ - std::min(first, rows_));
    std::vector<std::byte> rows;
    for (std::size_t i = 0; i < tables_.size(); ++i) {
      rows.clear();
      for (std::uint64_t row = first; row < rows_; ++row)
        rows.insert(rows.end(), tables_[i].held(row), tables_[i].held(row) + columns_[i]->row_bytes());
      columns_[i]->unpack(rows.data(), samples);
    }
    samples.insert(samples.end(), waiting_.begin(), waiting_.end());
    return samples;
  }

  void append_event(std::span<const std::byte> row) {
    events_sum_.add(row);
    events_->append_and_write_full(row);
    for (std::size_t i = 0; i < event_list_.size(); ++i)
      event_list_[i].append_and_write_full(
          row.subspan(layout::kEventColumns[i].offset, layout::kEventColumns[i].bytes));
  }

  void append_contact(std::span<const std::byte> row) {
    contacts_sum_.add(row);
    contacts_->append_and_write_full(row);
  }

  /// Puts rows into the tables, which must have room. Returns the rows as readers will see them.
  std::span<const Sample> put(std::span<const Sample> samples) {
    bool rounded = false;
    for (std::size_t i = 0; i < tables_.size(); ++i) {
      std::byte* const rows = tables_[i].end();
      columns_[i]->pack(samples, rows);
      if (tables_[i].round(samples.size())) {
        if (!std::exchange(rounded, true)) rounded_.assign(samples.begin(), samples.end());
        columns_[i]->unpack(rows, rounded_);
      }
      tables_[i].advance(samples.size());
    }
    return rounded ? std::span<const Sample>(rounded_) : samples;
  }

  /// Writes time last: a row with a time is then complete, whatever happens in between.
  void write_samples() {
    require_ours();
    const bool full = tables_.front().room() == 0;
    if (full) append_checksums();
    for (auto table = tables_.rbegin(); table != tables_.rend(); ++table) table->write();
    if (full) checksums_->write();
  }

  void write_rest() {
    require_ours();
    events_->write();
    if (contacts_) contacts_->write();
    for (Table& table : event_list_) table.write();
    overview_->write();
    clocks_->write();
    checked(H5Fflush(file_.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
  }

  void write_all() {
    if (summariser_.rows() > 0) append_overview();
    if (!tables_.front().chunk().empty()) append_checksums();
    write_samples();
    checksums_->write();
    hdf5::update_attribute(file_.get(), layout::kEventsChecksum, events_sum_.take());
    hdf5::update_attribute(file_.get(), layout::kOverviewChecksum, overview_sum_.take());
    if (contacts_) hdf5::update_attribute(file_.get(), layout::kContactsChecksum, contacts_sum_.take());
    write_rest();
  }

  void append_overview() {
    const std::vector<std::byte> row = overview_row(summariser_.take());
    overview_sum_.add(row);
    overview_->append_and_write_full(row);
  }

  /// Appends the checksums of the present chunk of every column.
  void append_checksums() {
    std::vector<std::uint64_t> row(tables_.size());
    std::transform(tables_.begin(), tables_.end(), row.begin(),
                   [](const Table& table) { return layout::checksum(table.chunk()); });
    checksums_->append_and_write_full(std::as_bytes(std::span(row)));
  }

  /// Throws if the disk has no room for further data. Everything so far is then in the file, which is closed.
  void claim_room() {
    const std::string refusal = reserve_->claim(size());
    if (refusal.empty()) return;
    const Event ended{.code = EventCode::recording_ended};
    append(StoredEvent{.time = last_time_, .code = static_cast<int>(ended.code), .text = describe(ended)});
    leave();
    throw input_error(refusal);
  }

  /// Throws if another program has overwritten this file: HDF5's further writes have no place in it.
  void require_ours() const {
    std::array<char, kUuid> found{};
    if (!uuid_at_) return;
    const ssize_t count = pread(reserve_->descriptor(), found.data(), found.size(), *uuid_at_);
    if (count < 0 || std::string_view(found.data(), static_cast<std::size_t>(count)) == uuid_) return;
    throw input_error("another program overwrote it");
  }

  void close() {
    release();
    if (!file_.close()) throw input_error("cannot be closed: " + hdf5::last_error());
    in_file_ = all();
    struct stat status {};
    if (fstat(reserve_->descriptor(), &status) == 0 && status.st_nlink == 0) rescue(reserve_->descriptor(), name_);
    reserve_.reset();
  }

  /// Closes a file that cannot be written any more. HDF5 would try to write, fail half-way with an unreadable
  /// superblock, and crash when the program ends. So its pending writes go nowhere, and the file stays as the last
  /// flush left it.
  void close_broken() noexcept {
    void* descriptor = nullptr;
    const int nowhere = memfd_create("haptrace", MFD_CLOEXEC);
    if (file_ && nowhere >= 0 && H5Fget_vfd_handle(file_.get(), H5P_DEFAULT, &descriptor) >= 0)
      dup2(nowhere, *static_cast<int*>(descriptor));
    if (nowhere >= 0) ::close(nowhere);
    release();
    file_.close();
    reserve_.reset();
  }

  /// Calls `visit` with every table.
  template <class Visit>
  void for_each_table(const Visit& visit) {
    for (Table& table : tables_) visit(table);
    for (Table& table : event_list_) visit(table);
    for (std::optional<Table>* table : {&events_, &contacts_, &overview_, &checksums_, &clocks_})
      if (*table) visit(**table);
  }

  void release() {
    for_each_table([](Table& table) { table.release(); });
  }

  void create(const RecordingHeader& header, const RecordingColumns& chosen, const Options& options) {
    create_attributes(file_.get(), header);
    hdf5::create_attribute(file_.get(), layout::kEventsChecksum, std::uint64_t{0});
    hdf5::create_attribute(file_.get(), layout::kOverviewChecksum, std::uint64_t{0});
    const hdf5::Group samples(
        checked(H5Gcreate2(file_.get(), "/samples", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "/samples"));
    rows_per_chunk_ = options.storage.rows_per_chunk;
    if (rows_per_chunk_ == 0) rows_per_chunk_ = filtered_ ? kFilteredRows : kPlainRows;
    std::vector<std::string> names;
    for (const layout::Column& column : layout::columns()) {
      if (!column.in(chosen)) continue;
      columns_.push_back(&column);
      names.emplace_back(column.name);
      tables_.emplace_back(file_.get(), column, rows_per_chunk_, options.storage);
    }
    const hid_t file = file_.get();
    if (chosen.contacts) {
      hdf5::create_attribute(file, layout::kContactsChecksum, std::uint64_t{0});
      contacts_.emplace(file, layout::kContacts, hdf5::contact_type().get(), 1, std::min(rows_per_chunk_, kPlainRows),
                        layout::kContactUnits, layout::kContactDescription, no_contact());
    }
    events_.emplace(file, layout::kEvents, hdf5::event_type().get(), 1, kEventsPerChunk, layout::kEventUnits,
                    layout::kEventDescription, event_row({kNaN, 0, ""}));
    const hdf5::Group list(
        checked(H5Gcreate2(file, layout::kEventList, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), layout::kEventList));
    const std::vector<std::byte> none = event_row({kNaN, 0, ""});
    for (const layout::EventColumn& column : layout::kEventColumns) {
      const auto first = none.begin() + static_cast<std::ptrdiff_t>(column.offset);
      event_list_.emplace_back(file, column.path, hdf5::event_column_type(column).get(), 1, kEventsPerChunk,
                               column.units, layout::kEventListDescription,
                               std::vector<std::byte>(first, first + static_cast<std::ptrdiff_t>(column.bytes)));
    }
    overview_.emplace(file, layout::kOverview, hdf5::overview_type().get(), 1, kOverviewPerChunk,
                      layout::kOverviewUnits, layout::kOverviewDescription, overview_row({}));
    checksums_.emplace(file, layout::kChecksums, H5T_STD_U64LE, names.size(), kChecksumsPerChunk,
                       layout::kChecksumUnits, layout::kChecksumDescription,
                       std::vector<std::byte>(sizeof(std::uint64_t) * names.size()));
    hdf5::create_attribute(checksums_->dataset(), layout::kChecksumRows, std::uint64_t{rows_per_chunk_});
    hdf5::create_attribute(checksums_->dataset(), layout::kChecksumColumns, fmt::format("{}", fmt::join(names, ",")));
    clocks_.emplace(file, layout::kClocks, H5T_STD_I64LE, layout::ClockRow{}.size(), kClocksPerChunk,
                    layout::kClockUnits, layout::kClockDescription, std::vector<std::byte>(sizeof(layout::ClockRow)));
  }

  /// HDF5 can start SWMR on an open file, but then it ignores the limit on attempts to read damaged data.
  void open_to_readers(const std::string& path) {
    release();
    if (!file_.close()) throw input_error("cannot be created: " + hdf5::last_error());
    file_ = hdf5::open_to_write(path);
    for_each_table([&](Table& table) { table.open_again(file_.get()); });
  }

  void begin(const std::string& uuid) {
    checked(H5Fflush(file_.get(), H5F_SCOPE_LOCAL), "cannot be flushed");
    void* descriptor = nullptr;
    checked(H5Fget_vfd_handle(file_.get(), H5P_DEFAULT, &descriptor), "has no descriptor");
    std::uint64_t chunk_bytes = 0;
    for (const layout::Column* column : columns_) chunk_bytes += rows_per_chunk_ * column->row_bytes();
    reserve_.emplace(*static_cast<int*>(descriptor), chunk_bytes);
    if (const std::string refusal = reserve_->claim(0); !refusal.empty()) throw input_error(refusal);
    mark_as_writer(reserve_->descriptor());

    uuid_ = uuid;
    std::string head(std::size_t{64} << 10U, '\0');  // contains the header of the root
    head.resize(
        static_cast<std::size_t>(std::max<ssize_t>(pread(reserve_->descriptor(), head.data(), head.size(), 0), 0)));
    const std::size_t at = head.find(uuid);
    if (uuid.size() == kUuid && at != std::string::npos) uuid_at_ = static_cast<off_t>(at);
  }

  static constexpr std::size_t kUuid = 36;  // characters

  std::string name_;
  bool filtered_;
  std::size_t rows_per_chunk_ = 0;
  hdf5::File file_;
  std::optional<Reserve> reserve_;
  std::string uuid_;
  std::optional<off_t> uuid_at_;  ///< place in the file, if it was found
  std::vector<const layout::Column*> columns_;
  std::vector<Table> tables_;      ///< one per column
  std::vector<Table> event_list_;  ///< one per column of /event_list
  std::optional<Table> events_, contacts_, overview_, checksums_, clocks_;
  std::vector<Sample> rounded_;
  std::vector<Sample> waiting_;  ///< samples that reached no table before the failure
  Summariser summariser_;        ///< of the rows that are not in /overview yet
  layout::Checksum events_sum_, contacts_sum_, overview_sum_;
  std::uint64_t rows_ = 0;
  double last_time_ = 0;         ///< [s]
  Content in_file_;              ///< at the last flush, or at the failure
  std::string failure_;          ///< reason why writing stopped; empty while it continues
  bool kept_elsewhere_ = false;  ///< the file was removed, and its content was saved under another name
};

RecordingWriter::RecordingWriter(const std::string& file, const RecordingHeader& header,
                                 const RecordingColumns& columns, const Options& options)
    : header_(header), columns_(columns), options_(options), name_(file) {
  validate(options.storage);
  if (header_.uuid.empty()) header_.uuid = boost::uuids::to_string(boost::uuids::random_generator()());
  if (header_.created.empty()) header_.created = rfc3339(std::chrono::system_clock::now());
  header_.complete = false;
  header_.format_version = RecordingHeader().format_version;
  if (!options.keep_part) {
    header_.part = 0;
    header_.part_of.clear();
    header_.continued = false;
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
  make_utf8(header_);
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

void RecordingWriter::append(std::span<const ContactSample> contacts) {
  file_->guarded([&] { file_->append(contacts); });
}

void RecordingWriter::append(const ClockReading& reading) {
  file_->guarded([&] { file_->append(reading); });
}

void RecordingWriter::flush() {
  file_->guarded([&] { file_->flush(); });
}

void RecordingWriter::sync() {
  file_->guarded([&] { file_->sync(); });
}

RecordingHeader RecordingWriter::header_of_next() const {
  RecordingHeader next = header_;
  next.part = std::max(header_.part, 1U) + 1;
  if (next.part_of.empty()) next.part_of = header_.uuid;
  next.uuid = boost::uuids::to_string(boost::uuids::random_generator()());
  return next;
}

void RecordingWriter::start_part() {
  if (!options_.in_parts) throw input_error(name_ + ": was not started as a recording in parts");
  file_->guarded([] {});
  RecordingHeader header = header_of_next();
  std::unique_ptr<File> next;
  try {
    next = std::make_unique<File>(part_file(name_, header.part), header, columns_, options_);
  } catch (const Error& error) {
    abandon();
    const std::string ends = fmt::format("the recording ends with part {}: {}", header_.part, error.what());
    if (!file_->failed()) file_->fail(ends);
    throw Error(Error::Kind::fault, ends);
  }
  try {
    file_->guarded([&] { file_->finish(true); });
  } catch (const Error&) {
    remove_empty(next);
    throw;
  }
  go_on(std::move(header), std::move(next));
}

std::uint64_t RecordingWriter::resume() {
  if (!file_->failed() || file_->kept_elsewhere())
    throw Error(Error::Kind::fault, file_->name() + ": has not failed, or was kept elsewhere");
  RecordingHeader header = header_of_next();
  std::unique_ptr<File> next;
  std::uint64_t lost = 0;
  try {
    next = std::make_unique<File>(part_file(name_, header.part), header, columns_, options_);
    next->guarded([&] { lost = next->take_over(*file_); });
  } catch (const Error& error) {
    remove_empty(next);
    throw Error(Error::Kind::fault, error.what());
  }
  go_on(std::move(header), std::move(next));
  return lost;
}

void RecordingWriter::go_on(RecordingHeader header, std::unique_ptr<File> next) {
  rows_before_ += file_->rows();
  header_ = std::move(header);
  file_ = std::move(next);
}

/// Removes a part that was created in vain.
void RecordingWriter::remove_empty(std::unique_ptr<File>& part) {
  if (!part) return;
  const std::string name = part->name();
  part.reset();
  std::error_code ignored;
  fs::remove(name, ignored);
}

void RecordingWriter::warn(const nlohmann::json& warnings) {
  file_->guarded([&] { file_->warn(warnings); });
}

void RecordingWriter::finish() {
  file_->guarded([&] { file_->finish(false); });
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

std::uint64_t RecordingWriter::part_bytes(std::size_t more) const {
  return file_->bytes(more);
}

const std::string& RecordingWriter::part() const noexcept {
  return file_->name();
}

std::string RecordingWriter::misplaced() const {
  return file_->misplaced();
}

}  // namespace haptrace
