#include "base/error.h"
#include "base/json_reader.h"
#include "base/number.h"
#include "formats/recording/cut_file.h"
#include "formats/recording/hdf5_support.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <limits>

namespace haptrace {
namespace {

constexpr std::uint64_t kReadBlock = 4096;  // rows
constexpr std::uint64_t kMostRowsOfChecksum = 1U << 24U;
constexpr std::uint64_t kDensest = 1100;  // deflate compresses at most 1032 bytes to one

std::map<std::string, std::string> read_meta(hid_t file) {
  std::map<std::string, std::string> meta;
  if (!hdf5::exists(file, layout::kMeta)) return meta;
  const hdf5::Object group = hdf5::open_object(file, layout::kMeta);
  for (const std::string& key : hdf5::attribute_names(group.get()))
    if (std::string value; hdf5::read_attribute(group.get(), key.c_str(), value)) meta.emplace(key, value);
  return meta;
}

RecordedScene read_scene_group(hid_t file, const std::string& name) {
  RecordedScene scene;
  if (!hdf5::exists(file, layout::kScene)) return scene;
  const hdf5::Object group = hdf5::open_object(file, layout::kScene);
  const std::string prefix = layout::kSceneFile;
  for (const std::string& key : hdf5::attribute_names(group.get())) {
    std::string value;
    if (!hdf5::read_attribute(group.get(), key.c_str(), value)) continue;
    if (key == layout::kSceneText) scene.text = value;
    if (key == layout::kSceneFolder) scene.folder = value;
    if (key == layout::kSceneObjects) {
      const nlohmann::json names = parse_json(value, fmt::format("{}: {}", name, layout::kScene));
      for (const nlohmann::json& object : names)
        if (object.is_string()) scene.objects.push_back(object.get<std::string>());
    }
    if (key.starts_with(prefix)) scene.files.emplace(key.substr(prefix.size()), value);
  }
  return scene;
}

/// Receives the messages of failed reads. Null: these errors are thrown.
using Lost = std::vector<std::string>*;

/// Calls `read`. If it throws, adds the message to `lost` and continues.
template <class Read>
void tolerate(Lost lost, const Read& read) {
  if (lost == nullptr) return read();
  try {
    read();
  } catch (const Error& error) {
    lost->emplace_back(error.what());
  }
}

/// Rejects a file that is newer than this program. With `lost`, a file whose version is damaged is read as the current
/// version.
void check_version(const std::string& file, const std::string& version, Lost lost) {
  std::string_view rest = version;
  const auto major = take_number<int>(rest);
  if (!major || !rest.starts_with('.'))
    return tolerate(
        lost, [&] { throw input_error(fmt::format("{}: format_version '{}' is not of the form 1.0", file, version)); });
  if (*major > layout::kMajorVersion)
    throw input_error(
        fmt::format("{}: format_version {} is newer than this program supports ({}.x); use a newer haptrace", file,
                    version, layout::kMajorVersion));
}

RecordingHeader read_header(hid_t root, const std::string& file, Lost lost) {
  tolerate(lost, [&] {
    std::string format;
    if (!hdf5::read_attribute(root, "format", format) || format != layout::kFormat)
      throw input_error(fmt::format("{}: is HDF5, but not a haptrace recording: its attribute format is not '{}'", file,
                                    layout::kFormat));
  });
  RecordingHeader header;
  if (lost == nullptr) header.format_version.clear();
  for (const layout::Attribute& attribute : layout::attributes())
    std::visit(
        [&](auto member) {
          if constexpr (std::is_same_v<decltype(member), nlohmann::json RecordingHeader::*>) {
            std::string text;
            if (hdf5::read_attribute(root, attribute.name, text) && !text.empty())
              tolerate(lost, [&] {
                header.*member = parse_json(text, fmt::format("{}: attribute {}", file, attribute.name));
              });
          } else {
            hdf5::read_attribute(root, attribute.name, header.*member);
          }
        },
        attribute.member);
  check_version(file, header.format_version, lost);
  tolerate(lost, [&] { header.meta = read_meta(root); });
  tolerate(lost, [&] { header.scene = read_scene_group(root, file); });
  return header;
}

void check_dataset(const hdf5::Dataset& dataset, const layout::Column& column, const std::string& file) {
  const hdf5::Type type(H5Dget_type(dataset.get()));
  const H5T_class_t wanted = layout::is_float(column.element) ? H5T_FLOAT : H5T_INTEGER;
  if (H5Tget_class(type.get()) != wanted)
    throw input_error(fmt::format("{}: {} does not hold {}", file, column.path(), to_string(column.element)));
  const std::vector<hsize_t> shape = hdf5::shape(dataset.get());
  if (shape.size() != (column.width > 1 ? 2 : 1) || (column.width > 1 && shape[1] != column.width))
    throw input_error(fmt::format("{}: {} has the shape [{}] instead of [N{}]", file, column.path(),
                                  fmt::join(shape, ", "), column.width > 1 ? fmt::format(", {}", column.width) : ""));
}

}  // namespace

/// One file of a recording.
class RecordingReader::Part {
 public:
  using Told = std::function<void(const Damage&)>;

  /// Opens a file. With `lost`, opens as much as possible and adds the rest to `lost`; null: errors are thrown.
  explicit Part(const std::string& file, Lost lost = nullptr)
      : name_(file),
        cut_(lost == nullptr ? std::nullopt : CutFile::of(file)),
        file_(cut_ ? cut_->open() : hdf5::open_to_read(file, lost == nullptr)),
        header_(read_header(file_.get(), file, lost)) {
    if (cut_) {
      lost->push_back(fmt::format("{}: is cut off: it has {} of {} bytes", file, cut_->present(), cut_->whole()));
      header_.complete = false;
    }
    open_datasets(lost);
    if (lost == nullptr)
      count_rows();
    else
      count_rows_of_damaged();
  }

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] const RecordingHeader& header() const noexcept { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const noexcept { return columns_; }
  [[nodiscard]] std::uint64_t rows() const noexcept { return rows_; }
  [[nodiscard]] std::uint64_t checksum_rows() const noexcept { return checksums_ ? checksum_rows_ : 1; }

  void refresh() {
    const hdf5::Object root(H5Oopen(file_.get(), "/", H5P_DEFAULT));
    const std::string what = name_ + ": cannot be read again";
    hdf5::checked(H5Orefresh(root.get()), what);
    // Before the datasets: if the recording is marked complete, all of them are read.
    hdf5::read_attribute(root.get(), "complete", header_.complete);
    hdf5::read_attribute(root.get(), layout::kContinued, header_.continued);
    hdf5::checked(H5Drefresh(events_.get()), what);
    for (const hdf5::Dataset* dataset : {&contacts_, &overview_, &checksums_, &clocks_})
      if (*dataset) hdf5::checked(H5Drefresh(dataset->get()), what);
    for (const Opened& entry : opened_) hdf5::checked(H5Drefresh(entry.dataset.get()), what);
    count_rows();
    read_checksums();
  }

  /// Fills `samples` from row `first` on. Reports values that differ from the recorded ones to `told`; without `told`,
  /// throws.
  void read(std::uint64_t first, std::span<Sample> samples, std::span<const std::string_view> names,
            const Told& told) const {
    std::vector<std::byte> buffer;
    for (std::size_t done = 0; done < samples.size(); done += kReadBlock) {
      const std::span block = samples.subspan(done, std::min<std::size_t>(kReadBlock, samples.size() - done));
      for (const Opened& entry : opened_) {
        if (!names.empty() && std::find(names.begin(), names.end(), entry.column->name) == names.end()) continue;
        buffer.resize(block.size() * entry.column->row_bytes());
        read_column(entry, first + done, block.size(), buffer.data());
        compare(entry, first + done, buffer, told);
        if (entry.column == &layout::columns().front()) check_time(first + done, buffer);
        entry.column->unpack(buffer.data(), block);
      }
    }
  }

  /// Reads a damaged file in the same way. Leaves unreadable values in `samples` unchanged, and reports them.
  void salvage(std::uint64_t first, std::span<Sample> samples, const Told& told) const {
    for (const Opened& entry : opened_) salvage(entry, first, samples, told);
  }

  /// Appends the paths of other programs' objects in the file; those of attributes have an @.
  void append_foreign(std::vector<std::string>& found) const {
    const std::vector<std::string> known = layout::paths();
    const auto is_known = [&](const std::string& path) {
      return std::any_of(known.begin(), known.end(),
                         [&](const std::string& ours) { return ours == path || ours.starts_with(path + "/"); });
    };
    for (const char* group : {"/", "/samples/"})
      if (const hdf5::Object opened{H5Oopen(file_.get(), group, H5P_DEFAULT)})
        for (const std::string& name : hdf5::link_names(opened.get()))
          if (!is_known(group + name)) found.push_back(group + name);
    const auto attributes = layout::attributes();
    for (const std::string& name : hdf5::attribute_names(file_.get()))
      if (name != "format" && name != layout::kEventsChecksum && name != layout::kOverviewChecksum &&
          name != layout::kContactsChecksum &&
          std::none_of(attributes.begin(), attributes.end(), [&](const auto& ours) { return name == ours.name; }))
        found.push_back("/@" + name);
  }

  void append_events(std::vector<StoredEvent>& events, const Told& told) const {
    if (!events_) return;
    const hsize_t count = hdf5::shape(events_.get())[0];
    check_length(layout::kEvents, count);
    const hdf5::Type type = hdf5::event_type(characters_of_events());
    std::vector<char> rows;
    layout::Checksum sum;
    for (hsize_t first = 0; first < count; first += kReadBlock) {
      const hsize_t block = std::min<hsize_t>(kReadBlock, count - first);
      rows.resize(block * layout::EventRow::kBytes);
      hdf5::read_rows(events_.get(), fmt::format("{}: {}", name_, layout::kEvents), type.get(), first, block,
                      rows.data());
      sum.add(std::as_bytes(std::span(rows)));
      for (const char* row = rows.data(); row != rows.data() + rows.size(); row += layout::EventRow::kBytes) {
        StoredEvent& event = events.emplace_back();
        std::memcpy(&event.time, row + layout::EventRow::kTime, sizeof event.time);
        std::memcpy(&event.code, row + layout::EventRow::kCode, sizeof event.code);
        event.text.assign(row + layout::EventRow::kText,
                          strnlen(row + layout::EventRow::kText, layout::EventRow::kTextBytes));
        // Rows that were allocated but never written.
        if (std::isnan(event.time)) events.pop_back();
      }
    }
    if (is_other(layout::kEventsChecksum, sum))
      tell({name_, layout::kEvents, 0, std::max<hsize_t>(count, 1), kNotRecorded}, told);
  }

  [[nodiscard]] std::uint64_t contact_rows() const { return contacts_ ? hdf5::shape(contacts_.get())[0] : 0; }

  /// Appends contacts [first, first + count), which must be there. `sum`: takes their bytes; may be null.
  void append_contacts(std::uint64_t first, std::uint64_t count, std::vector<ContactSample>& contacts,
                       layout::Checksum* sum) const {
    const hdf5::Type type = hdf5::contact_type();
    std::vector<std::byte> rows;
    for (std::uint64_t done = 0; done < count; done += kReadBlock) {
      const hsize_t block = std::min<hsize_t>(kReadBlock, count - done);
      rows.resize(block * layout::ContactRow::kBytes);
      hdf5::read_rows(contacts_.get(), fmt::format("{}: {}", name_, layout::kContacts), type.get(), first + done, block,
                      rows.data());
      if (sum != nullptr) sum->add(rows);
      for (std::size_t row = 0; row < block; ++row)
        contacts.push_back(layout::unpack_contact(rows.data() + row * layout::ContactRow::kBytes));
    }
  }

  /// Reports contacts that differ from the recorded ones.
  void verify_contacts(const Told& told) const {
    layout::Checksum sum;
    std::vector<ContactSample> block;
    for (std::uint64_t first = 0; first < contact_rows(); first += kReadBlock) {
      block.clear();
      append_contacts(first, std::min<std::uint64_t>(kReadBlock, contact_rows() - first), block, &sum);
    }
    if (is_other(layout::kContactsChecksum, sum))
      tell({name_, layout::kContacts, 0, std::max<std::uint64_t>(contact_rows(), 1), kNotRecorded}, told);
  }

  /// Omits a reading that differs from the recorded one, and reports it if there is `told`: the other readings agree
  /// anyway.
  void append_clocks(std::vector<ClockReading>& clocks, const Told& told) const {
    if (!clocks_) return;
    const hsize_t count = hdf5::shape(clocks_.get())[0];
    check_length(layout::kClocks, count);
    std::vector<layout::ClockRow> rows(count);
    if (count > 0)
      hdf5::read_rows(clocks_.get(), fmt::format("{}: {}", name_, layout::kClocks), H5T_NATIVE_INT64, 0, count,
                      rows.data());
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (const std::optional<ClockReading> reading = layout::unpack(rows[i]))
        clocks.push_back(*reading);
      else if (told && rows[i] != layout::ClockRow{})  // otherwise it was allocated but never written
        told({name_, layout::kClocks, i, 1, kNotRecorded});
  }

  [[nodiscard]] int deflate() const {
    const hdf5::Dataset position = open("/samples/position");
    const auto level = hdf5::filter_of(position, H5Z_FILTER_DEFLATE);
    return level ? static_cast<int>(level->front()) : 0;
  }

  /// Returns the stored summaries of the blocks whose rows are present. Omits summaries that differ from the recorded
  /// ones, and reports them if there is `told`: they can be computed from the rows.
  [[nodiscard]] std::vector<RecordingSummary> stored_overview(const Told& told) const {
    std::vector<RecordingSummary> blocks;
    if (!overview_) return blocks;
    const hdf5::Type type = hdf5::overview_type();
    const std::size_t bytes = H5Tget_size(type.get());
    const hsize_t count = hdf5::shape(overview_.get())[0];
    // Each block has at least one row of the recording: more blocks than rows are damage.
    if (count > rows_) return blocks;
    std::vector<std::byte> rows(count * bytes);
    if (count > 0)
      hdf5::read_rows(overview_.get(), fmt::format("{}: {}", name_, layout::kOverview), type.get(), 0, count,
                      rows.data());
    layout::Checksum sum;
    sum.add(rows);
    if (is_other(layout::kOverviewChecksum, sum)) {
      if (told) told({name_, layout::kOverview, 0, std::max<hsize_t>(count, 1), kNotRecorded});
      return blocks;
    }
    std::uint64_t known = 0;
    for (const std::byte* row = rows.data(); row != rows.data() + rows.size();) {
      RecordingSummary block;
      for (const layout::OverviewField& field : layout::overview_fields()) {
        field.unpack(row, block);
        row += field.bytes();
      }
      if (block.rows == 0 || block.rows > rows_ - known) break;
      known += block.rows;
      blocks.push_back(block);
    }
    return blocks;
  }

 private:
  static constexpr const char* kNoChecksum = "has no checksum, though the recording was finished";
  static constexpr const char* kNotRecorded =
      "holds values that differ from the recorded ones: the disk or a program changed them";

  struct Opened {
    const layout::Column* column;
    hdf5::Dataset dataset;
    std::uint64_t chunk_rows = 1;
    bool packed = false;                           ///< has filters
    std::optional<layout::DecimalGrid> grid = {};  ///< grid to which its values are rounded
    std::optional<std::size_t> checksum = {};      ///< its column in checksums_
    mutable layout::Checksum sum = {};             ///< of the rows since the start of the block
    mutable std::uint64_t next = 0;                ///< the row that `sum` expects next
  };

  void open_datasets(Lost lost) {
    if (lost != nullptr) require_inside();
    columns_ = hdf5::present_columns(file_.get());
    std::vector<std::string> missing;
    for (const layout::Column& column : layout::columns()) {
      if (!column.in(columns_)) continue;
      tolerate(lost, [&] {
        hdf5::Dataset dataset = open(column.path());
        if (!dataset) {
          missing.push_back(column.path());
          return;
        }
        check_dataset(dataset, column, name_);
        opened_.push_back({&column, std::move(dataset)});
        opened_.back().chunk_rows = hdf5::chunk_rows(opened_.back().dataset.get());
        const hdf5::Properties creation(H5Dget_create_plist(opened_.back().dataset.get()));
        opened_.back().packed = H5Pget_nfilters(creation.get()) > 0;
        const std::optional<int> digits = hdf5::decimal_digits(opened_.back().dataset);
        if (digits && layout::has_grid(header_.format_version)) opened_.back().grid.emplace(*digits);
      });
    }
    tolerate(lost, [&] { open_events(missing); });
    tolerate(lost, [&] {
      if (!missing.empty())
        throw input_error(fmt::format("{}: is not a complete recording: it lacks {}", name_, fmt::join(missing, ", ")));
    });
    tolerate(lost, [&] { open_contacts(); });
    open_overview();
    open_clocks();
    tolerate(lost, [&] { open_checksums(); });
  }

  /// Throws if the file leads to others. All other damage is only reported.
  void require_inside() const {
    for (const std::string& path : layout::paths())
      if (const std::string outside = hdf5::why_outside(file_.get(), path); !outside.empty())
        throw input_error(
            fmt::format("{}: {}: {}; haptrace does not read data outside the file", name_, path, outside));
  }

  void open_events(std::vector<std::string>& missing) {
    events_ = open(layout::kEvents);
    if (!events_) return missing.emplace_back(layout::kEvents), void();
    const hdf5::Type type(H5Dget_type(events_.get()));
    if (H5Tget_class(type.get()) == H5T_COMPOUND && hdf5::shape(events_.get()).size() == 1) return;
    events_ = hdf5::Dataset{};
    throw input_error(fmt::format("{}: {} is not a list of time, code and text", name_, layout::kEvents));
  }

  void open_contacts() {
    contacts_ = open(layout::kContacts);
    if (!contacts_) return;
    const hdf5::Type row(H5Dget_type(contacts_.get()));
    if (H5Tequal(row.get(), hdf5::contact_type().get()) > 0 && hdf5::shape(contacts_.get()).size() == 1)
      return check_length(layout::kContacts, hdf5::shape(contacts_.get())[0]);
    contacts_ = hdf5::Dataset{};
    throw input_error(fmt::format("{}: {} is not a list of contacts", name_, layout::kContacts));
  }

  // If the following datasets are absent or have another shape, that costs time or information, but no data.

  void open_overview() {
    overview_ = open(layout::kOverview);
    if (!overview_) return;
    const hdf5::Type row(H5Dget_type(overview_.get()));
    if (H5Tequal(row.get(), hdf5::overview_type().get()) <= 0 || hdf5::shape(overview_.get()).size() != 1)
      overview_ = hdf5::Dataset{};
  }

  void open_clocks() {
    clocks_ = open(layout::kClocks);
    if (!clocks_) return;
    const hdf5::Type type(H5Dget_type(clocks_.get()));
    const std::vector<hsize_t> shape = hdf5::shape(clocks_.get());
    if (H5Tget_class(type.get()) != H5T_INTEGER || shape.size() != 2 || shape[1] != layout::ClockRow{}.size())
      clocks_ = hdf5::Dataset{};
  }

  void open_checksums() {
    checksums_ = open(layout::kChecksums);
    if (!checksums_) return;
    std::string names;
    hdf5::read_attribute(checksums_.get(), layout::kChecksumRows, checksum_rows_);
    hdf5::read_attribute(checksums_.get(), layout::kChecksumColumns, names);
    std::size_t width = 0;
    for (std::string_view rest = names; !rest.empty(); ++width) {
      const std::string_view name = rest.substr(0, rest.find(','));
      rest.remove_prefix(std::min(rest.size(), name.size() + 1));
      for (Opened& entry : opened_)
        if (entry.column->name == name) entry.checksum = width;
    }
    const std::vector<hsize_t> shape = hdf5::shape(checksums_.get());
    const hsize_t found = shape.size() == 2 ? shape[1] : 1;  // one column may have a list
    if (shape.empty() || found != width || checksum_rows_ == 0 || checksum_rows_ > kMostRowsOfChecksum)
      checksums_ = hdf5::Dataset{};
    else
      checksum_columns_ = width;
    read_checksums();
  }

  void read_checksums() {
    left_open_ = hdf5::was_left_open(name_);
    sums_.clear();
    if (!checksums_) return;
    const hsize_t count = hdf5::shape(checksums_.get())[0];
    check_length(layout::kChecksums, count);
    sums_.resize(count * checksum_columns_);
    if (count > 0)
      hdf5::read_rows(checksums_.get(), fmt::format("{}: {}", name_, layout::kChecksums), H5T_NATIVE_UINT64, 0, count,
                      sums_.data());
    const std::size_t row_bytes = checksum_columns_ * sizeof(std::uint64_t);
    for (hsize_t row = 0; cut_ && row < count; ++row)
      if (!cut_->holds(checksums_, row, 1, hdf5::chunk_rows(checksums_.get()), row_bytes))
        std::fill_n(sums_.begin() + static_cast<std::ptrdiff_t>(row * checksum_columns_), checksum_columns_, 0);
  }

  /// Returns true if the root attribute `name` has another checksum. Until the file is complete, the attribute may be
  /// ahead of the rows.
  bool is_other(const char* name, layout::Checksum& sum) const {
    if (!header_.complete) return false;
    std::uint64_t recorded = 0;
    const hdf5::Object root(H5Oopen(file_.get(), "/", H5P_DEFAULT));
    return hdf5::read_attribute(root.get(), name, recorded) && recorded != 0 && recorded != sum.take();
  }

  void tell(const Damage& damage, const Told& told) const {
    if (told) return told(damage);
    throw input_error(fmt::format("{}: {} {} in rows {} to {}; haptrace recover saves the rest", damage.file,
                                  damage.path, damage.what, damage.first, damage.first + damage.count - 1));
  }

  /// Compares values of a column, from row `first` on, with the checksums of the blocks that end in them.
  void compare(const Opened& entry, std::uint64_t first, std::span<const std::byte> rows, const Told& told) const {
    if (!entry.checksum || !checksums_) return;
    const std::size_t row_bytes = entry.column->row_bytes();
    const std::uint64_t end = first + rows.size() / row_bytes;
    std::uint64_t row = first;
    if (row != entry.next) {  // not in order: start with the next block
      (void)entry.sum.take();
      row = (row + checksum_rows_ - 1) / checksum_rows_ * checksum_rows_;
    }
    while (row < end) {
      const std::uint64_t block = row / checksum_rows_;
      const std::uint64_t block_end = std::min((block + 1) * checksum_rows_, rows_);
      const std::uint64_t here = std::min(block_end, end);
      entry.sum.add(rows.subspan((row - first) * row_bytes, (here - row) * row_bytes));
      row = here;
      if (here < block_end) break;
      const std::uint64_t found = entry.sum.take();
      const std::size_t at = block * checksum_columns_ + *entry.checksum;
      // A writer that is at work or was killed has not stored the checksum of its last block.
      const bool whole = block_end == (block + 1) * checksum_rows_ || !left_open_ || header_.complete;
      const std::uint64_t recorded = whole && at < sums_.size() ? sums_[at] : 0;
      const std::uint64_t begin = block * checksum_rows_;
      // A finished recording has all checksums.
      if (recorded != found && (recorded != 0 || header_.complete))
        tell({name_, entry.column->path(), begin, block_end - begin, recorded != 0 ? kNotRecorded : kNoChecksum}, told);
    }
    // A block that is cut short by the end of the rows may grow: do not continue it.
    const bool cut = row == rows_ && row % checksum_rows_ != 0;
    entry.next = cut ? std::numeric_limits<std::uint64_t>::max() : std::max(row, end);
  }

  /// Gives up rows that cannot be read, in pieces of kSmallest.
  void salvage(const Opened& entry, std::uint64_t first, std::span<Sample> samples, const Told& told) const {
    constexpr std::size_t kSmallest = 64;
    const hsize_t present = hdf5::shape(entry.dataset.get())[0];
    const std::size_t row_bytes = entry.column->row_bytes();
    std::vector<std::byte> buffer(samples.size() * row_bytes);
    const bool there = !cut_ || cut_->holds(entry.dataset, first, samples.size(), entry.chunk_rows, row_bytes);
    if (first + samples.size() <= present && there) {
      try {
        read_column(entry, first, samples.size(), buffer.data());
        compare(entry, first, buffer, told);
        return entry.column->unpack(buffer.data(), samples);
      } catch (const Error&) {
        // Some of them cannot be read. Try smaller pieces.
      }
    }
    // A compressed chunk is lost as a whole; uncompressed rows are lost in pieces.
    const std::uint64_t middle = first + samples.size() / 2, chunk = middle / entry.chunk_rows * entry.chunk_rows;
    const std::uint64_t edge = chunk > first ? chunk : chunk + entry.chunk_rows;
    std::size_t half = samples.size() / 2;
    if (edge > first && edge < first + samples.size())
      half = edge - first;
    else if (samples.size() <= kSmallest || entry.packed)
      return told({name_, entry.column->path(), first, samples.size(), "cannot be read", false});
    salvage(entry, first, samples.first(half), told);
    salvage(entry, first + half, samples.subspan(half), told);
  }

  [[nodiscard]] hdf5::Dataset open(const std::string& path) const { return hdf5::open_dataset(file_.get(), path); }

  [[nodiscard]] H5T_cset_t characters_of_events() const {
    const hdf5::Type row(H5Dget_type(events_.get()));
    const int text = H5Tget_member_index(row.get(), "text");
    const hdf5::Type type(text < 0 ? H5I_INVALID_HID : H5Tget_member_type(row.get(), static_cast<unsigned>(text)));
    if (!type || H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0)
      throw input_error(fmt::format("{}: {} has no text of fixed length", name_, layout::kEvents));
    return H5Tget_cset(type.get());
  }

  void count_rows() {
    const auto rows_of = [](const Opened& entry) { return hdf5::shape(entry.dataset.get())[0]; };
    const auto shortest = std::min_element(opened_.begin(), opened_.end(),
                                           [&](const Opened& a, const Opened& b) { return rows_of(a) < rows_of(b); });
    rows_ = rows_of(*shortest);
    // The columns grow one after the other while the file is written.
    if (const std::uint64_t times = rows_of(opened_.front()); header_.complete && rows_ < times)
      throw input_error(
          fmt::format("{}: {} has {} rows where /samples/time has {}; haptrace recover saves the complete samples",
                      name_, shortest->column->path(), rows_, times));
    check_length("/samples/time", rows_);
    // A writer that found the disk full extended its datasets before it failed to fill them; time is filled last.
    std::array<double, kReadBlock> time{};
    while (rows_ > 0) {
      const std::uint64_t count = std::min(kReadBlock, rows_);
      read_column(opened_.front(), rows_ - count, count, time.data());
      const auto end = time.begin() + static_cast<std::ptrdiff_t>(count);
      const auto last = std::find_if(std::reverse_iterator(end), std::reverse_iterator(time.begin()),
                                     [](double t) { return !std::isnan(t); });
      rows_ -= static_cast<std::uint64_t>(last - std::reverse_iterator(end));
      if (last.base() != time.begin()) break;
    }
  }

  /// Counts the rows of the time, which is written last. Without it, counts the rows that all columns have.
  void count_rows_of_damaged() {
    if (opened_.empty()) throw input_error(name_ + ": none of its samples can be opened");
    rows_ = std::numeric_limits<std::uint64_t>::max();
    for (const Opened& entry : opened_) {
      rows_ = std::min<std::uint64_t>(rows_, hdf5::shape(entry.dataset.get())[0]);
      if (entry.column != &layout::columns().front()) continue;
      rows_ = hdf5::shape(entry.dataset.get())[0];
      break;
    }
    check_length("/samples/time", rows_);
    double last = 0;
    try {
      while (rows_ > 0 && opened_.front().column == &layout::columns().front()) {
        read_column(opened_.front(), rows_ - 1, 1, &last);
        if (!std::isnan(last)) break;
        --rows_;
      }
    } catch (const Error&) {
      // The rows are reported later, as rows whose time cannot be read.
    }
  }

  /// Throws if the length cannot be right: a damaged length would be read for hours.
  void check_length(const char* path, std::uint64_t length) const {
    std::error_code error;
    const std::uint64_t bytes = cut_ ? cut_->whole() : std::filesystem::file_size(name_, error);
    if (error || length / kDensest > bytes / sizeof(double))
      throw input_error(fmt::format("{}: is damaged: {} cannot have {} rows in {} bytes", name_, path, length, bytes));
  }

  void read_column(const Opened& entry, std::uint64_t first, std::uint64_t count, void* values) const {
    hdf5::read_rows(entry.dataset.get(), fmt::format("{}: {}", name_, entry.column->path()),
                    hdf5::stored_type(entry.column->element), first, count, values);
    if (entry.grid)
      entry.grid->snap({static_cast<std::byte*>(values), static_cast<std::size_t>(count) * entry.column->row_bytes()});
  }

  void check_time(std::uint64_t first, const std::vector<std::byte>& buffer) const {
    const std::span time(reinterpret_cast<const double*>(buffer.data()), buffer.size() / sizeof(double));
    const auto bad =
        std::find_if_not(time.begin(), time.end(), [](double t) { return std::abs(t) < layout::kLongestTime; });
    if (bad != time.end())
      throw input_error(fmt::format("{}: /samples/time[{}] is {}, which is not a time", name_,
                                    first + static_cast<std::uint64_t>(bad - time.begin()), *bad));
  }

  std::string name_;
  std::optional<CutFile> cut_;
  hdf5::File file_;
  RecordingHeader header_;
  RecordingColumns columns_;
  std::vector<Opened> opened_;  ///< time is the first
  hdf5::Dataset events_, contacts_, overview_, checksums_, clocks_;
  std::uint64_t rows_ = 0;
  std::uint64_t checksum_rows_ = 0;  ///< per block, except the last
  std::size_t checksum_columns_ = 0;
  std::vector<std::uint64_t> sums_;  ///< [blocks, columns]
  bool left_open_ = false;           ///< by a writer that is at work or was killed
};

RecordingReader::RecordingReader(const std::string& file, Parts which) : RecordingReader(file, which, false) {}

RecordingReader::RecordingReader(const std::string& file, Parts which, bool salvages)
    : which_(which), salvages_(salvages) {
  const hdf5::Silence silence;
  parts_.push_back(std::make_unique<Part>(file, salvages_ ? &lost_ : nullptr));
  open_further_parts();
}

RecordingReader RecordingReader::for_salvage(const std::string& file, Parts which) {
  return {file, which, true};
}

RecordingReader::~RecordingReader() = default;
RecordingReader::RecordingReader(RecordingReader&&) noexcept = default;
RecordingReader& RecordingReader::operator=(RecordingReader&&) noexcept = default;

void RecordingReader::open_further_parts() {
  if (which_ == Parts::this_file || parts_.front()->header().part > 1) return;
  const RecordingHeader& first = parts_.front()->header();
  if (first.part == 0 && first.complete) return;
  const std::string& name = parts_.front()->name();
  const std::string& origin = first.part_of.empty() ? first.uuid : first.part_of;
  missing_.clear();
  std::uint32_t next = std::max(parts_.back()->header().part, 1U) + 1;
  for (;; ++next) {
    const std::string file = part_file(name, next);
    if (std::unique_ptr<Part> part = open_part(file, next, origin)) {
      parts_.push_back(std::move(part));
      continue;
    }
    // The last file states whether it is the last. If that file is missing, only a later file shows that parts are
    // missing.
    const bool continued = missing_.empty() && parts_.back()->header().continued;
    if (!continued && !later_part(next, origin)) break;
    missing_.push_back(file);
  }
  if (missing_.empty() || which_ == Parts::present) return;
  throw input_error(
      fmt::format("{}: {} {} missing, which {} of this recording; put {} there, or continue without (--partial)", name,
                  fmt::join(missing_, ", "), missing_.size() > 1 ? "are" : "is",
                  missing_.size() > 1 ? "are parts" : "is a part", missing_.size() > 1 ? "them" : "it"));
}

/// Opens the file if it is part `number` of the recording that began with `origin`; otherwise returns null.
std::unique_ptr<RecordingReader::Part> RecordingReader::open_part(const std::string& file, std::uint32_t number,
                                                                  const std::string& origin) {
  if (!is_hdf5(file)) return nullptr;
  try {
    auto part = std::make_unique<Part>(file, salvages_ ? &lost_ : nullptr);
    if (part->header().part == number && part->header().part_of == origin) return part;
  } catch (const Error&) {
    if (which_ != Parts::present) throw;
  }
  return nullptr;
}

/// Returns true if the folder holds a part of this recording with a number above `number`.
bool RecordingReader::later_part(std::uint32_t number, const std::string& origin) const {
  const std::filesystem::path first(parts_.front()->name());
  const std::string stem = first.stem().string() + ".part", ending = first.extension().string();
  std::error_code error;
  const auto folder = first.has_parent_path() ? first.parent_path() : std::filesystem::path(".");
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(stem) || !name.ends_with(ending) || name.size() <= stem.size() + ending.size()) continue;
    const std::string_view digits =
        std::string_view(name).substr(stem.size(), name.size() - stem.size() - ending.size());
    const std::uint32_t found = number_of<std::uint32_t>(digits).value_or(0);
    if (found <= number || !is_hdf5(entry.path().string())) continue;
    try {
      const hdf5::File file = hdf5::open_to_read(entry.path().string());
      const RecordingHeader header = read_header(file.get(), name, nullptr);
      if (header.part == found && header.part_of == origin) return true;
    } catch (const Error&) {
      // Nothing shows that it belongs to this recording.
    }
  }
  return false;
}

RecordingHeader RecordingReader::header() const {
  RecordingHeader header = parts_.front()->header();
  header.complete = parts_.back()->header().complete && missing_.empty();
  header.warnings = parts_.back()->header().warnings;
  return header;
}

const RecordingColumns& RecordingReader::columns() const noexcept {
  return parts_.front()->columns();
}

std::uint64_t RecordingReader::rows() const noexcept {
  std::uint64_t rows = 0;
  for (const auto& part : parts_) rows += part->rows();
  return rows;
}

std::uint32_t RecordingReader::parts() const noexcept {
  return static_cast<std::uint32_t>(parts_.size());
}

int RecordingReader::deflate() const {
  const hdf5::Silence silence;
  return parts_.front()->deflate();
}

void RecordingReader::refresh() {
  const hdf5::Silence silence;
  parts_.back()->refresh();
  open_further_parts();
}

std::vector<Sample> RecordingReader::read(std::uint64_t first, std::uint64_t count) const {
  return read(first, count, {});
}

std::vector<Sample> RecordingReader::read(std::uint64_t first, std::uint64_t count,
                                          std::span<const std::string_view> names) const {
  return read_parts(first, count, [&](const Part& part, std::uint64_t begin, std::span<Sample> samples) {
    part.read(begin, samples, names, told_);
  });
}

std::vector<Sample> RecordingReader::salvage(std::uint64_t first, std::uint64_t count) const {
  const std::function<void(const Damage&)> nobody = [](const Damage&) {};
  return read_parts(first, count, [&](const Part& part, std::uint64_t begin, std::span<Sample> samples) {
    part.salvage(begin, samples, told_ ? told_ : nobody);
  });
}

std::vector<Sample> RecordingReader::read_parts(
    std::uint64_t first, std::uint64_t count,
    const std::function<void(const Part&, std::uint64_t first, std::span<Sample>)>& read) const {
  const hdf5::Silence silence;
  first = std::min(first, rows());
  std::vector<Sample> samples(std::min(count, rows() - first));
  std::span<Sample> rest(samples);
  for (const auto& part : parts_) {
    if (first >= part->rows()) {
      first -= part->rows();
      continue;
    }
    const std::size_t here = std::min<std::size_t>(rest.size(), part->rows() - first);
    read(*part, first, rest.first(here));
    rest = rest.subspan(here);
    first = 0;
  }
  return samples;
}

void RecordingReader::on_damage(std::function<void(const Damage&)> told) {
  told_ = std::move(told);
}

std::uint64_t RecordingReader::checksum_rows() const noexcept {
  return parts_.front()->checksum_rows();
}

const std::vector<std::string>& RecordingReader::lost() const noexcept {
  return lost_;
}

const std::vector<std::string>& RecordingReader::missing_parts() const noexcept {
  return missing_;
}

std::vector<std::string> RecordingReader::files() const {
  std::vector<std::string> files(parts_.size());
  std::transform(parts_.begin(), parts_.end(), files.begin(), [](const auto& part) { return part->name(); });
  return files;
}

std::vector<std::string> RecordingReader::foreign() const {
  const hdf5::Silence silence;
  std::vector<std::string> found;
  for (const auto& part : parts_) part->append_foreign(found);
  return found;
}

std::vector<StoredEvent> RecordingReader::events() const {
  const hdf5::Silence silence;
  std::vector<StoredEvent> events;
  for (const auto& part : parts_) part->append_events(events, told_);
  return events;
}

std::uint64_t RecordingReader::contact_rows() const {
  const hdf5::Silence silence;
  std::uint64_t rows = 0;
  for (const auto& part : parts_) rows += part->contact_rows();
  return rows;
}

std::vector<ContactSample> RecordingReader::contacts(std::uint64_t first, std::uint64_t count) const {
  const hdf5::Silence silence;
  std::vector<ContactSample> contacts;
  for (const auto& part : parts_) {
    const std::uint64_t rows = part->contact_rows();
    if (first < rows) {
      const std::uint64_t here = std::min(count, rows - first);
      part->append_contacts(first, here, contacts, nullptr);
      count -= here;
      first = 0;
    } else {
      first -= rows;
    }
  }
  return contacts;
}

std::uint64_t RecordingReader::contact_at(std::int64_t time_ns) const {
  std::uint64_t low = 0, high = contact_rows();
  while (low < high) {
    const std::uint64_t middle = low + (high - low) / 2;
    if (contacts(middle, 1).front().time_ns < time_ns)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

void RecordingReader::verify_contacts() const {
  const hdf5::Silence silence;
  for (const auto& part : parts_) part->verify_contacts(told_);
}

std::vector<ClockReading> RecordingReader::clocks() const {
  const hdf5::Silence silence;
  std::vector<ClockReading> clocks;
  for (const auto& part : parts_) part->append_clocks(clocks, told_);
  return clocks;
}

std::vector<RecordingSummary> RecordingReader::overview(const std::function<void(std::uint64_t)>& progress) const {
  const hdf5::Silence silence;
  std::vector<RecordingSummary> blocks;
  std::uint64_t begin = 0;  // first row of the part
  for (const auto& part : parts_) {
    std::uint64_t row = 0;
    for (RecordingSummary& block : part->stored_overview(told_)) {
      row += block.rows;
      blocks.push_back(std::move(block));
    }
    Summariser summariser;
    while (row < part->rows()) {
      const std::vector<Sample> samples = read(begin + row, std::min(layout::kOverviewRows, part->rows() - row));
      summariser.add(samples);
      row += samples.size();
      blocks.push_back(summariser.take());
      if (progress) progress(begin + row);
    }
    begin += part->rows();
  }
  return blocks;
}

std::uint64_t RecordingReader::row_at(std::int64_t time_ns) const {
  constexpr std::array<std::string_view, 1> kTime{"time"};
  std::uint64_t low = 0, high = rows();  // the row is in [low, high), if it exists
  while (high - low > 1) {
    const std::uint64_t middle = low + (high - low) / 2;
    if (read(middle, 1, kTime).front().time_ns <= time_ns)
      low = middle;
    else
      high = middle;
  }
  return low;
}

bool is_hdf5(const std::string& file) {
  constexpr std::string_view kSignature = "\x89HDF\r\n\x1a\n";
  std::array<char, kSignature.size()> head{};
  std::ifstream(file, std::ios::binary).read(head.data(), head.size());
  return std::string_view(head.data(), head.size()) == kSignature;
}

}  // namespace haptrace
