#include "control/error.h"
#include "formats/hdf5_support.h"
#include "formats/json_reader.h"
#include "formats/recording_layout.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>

namespace haptrace {
namespace {

constexpr std::uint64_t kReadBlock = 4096;  // rows
constexpr std::uint64_t kDensest = 1100;    // deflate cannot pack bytes closer than 1032 to one

void check_version(const std::string& file, const std::string& version) {
  int major = 0;
  const char* end = version.data() + version.size();
  const auto parsed = std::from_chars(version.data(), end, major);
  if (parsed.ec != std::errc{} || parsed.ptr == end || *parsed.ptr != '.')
    throw input_error(fmt::format("{}: format_version '{}' is not of the form 1.0", file, version));
  if (major > layout::kMajorVersion)
    throw input_error(fmt::format("{}: format_version {} is newer than this program knows ({}.x); use a newer haptrace",
                                  file, version, layout::kMajorVersion));
}

std::map<std::string, std::string> read_meta(hid_t file) {
  std::map<std::string, std::string> meta;
  if (!hdf5::exists(file, layout::kMeta)) return meta;
  const hdf5::Object group = hdf5::open_object(file, layout::kMeta);
  for (const std::string& key : hdf5::attribute_names(group.get()))
    if (std::string value; hdf5::read_attribute(group.get(), key.c_str(), value)) meta.emplace(key, value);
  return meta;
}

RecordingHeader read_header(hid_t root, const std::string& file) {
  std::string format;
  if (!hdf5::read_attribute(root, "format", format) || format != layout::kFormat)
    throw input_error(fmt::format("{}: is HDF5, but not a haptrace recording: its attribute format is not '{}'", file,
                                  layout::kFormat));
  RecordingHeader header;
  header.format_version.clear();
  for (const layout::Attribute& attribute : layout::attributes())
    std::visit(
        [&](auto member) {
          if constexpr (std::is_same_v<decltype(member), nlohmann::json RecordingHeader::*>) {
            std::string text;
            if (hdf5::read_attribute(root, attribute.name, text) && !text.empty())
              header.*member = parse_json(text, fmt::format("{}: attribute {}", file, attribute.name));
          } else {
            hdf5::read_attribute(root, attribute.name, header.*member);
          }
        },
        attribute.member);
  check_version(file, header.format_version);
  header.meta = read_meta(root);
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
  explicit Part(const std::string& file)
      : name_(file), file_(hdf5::open_to_read(file)), header_(read_header(file_.get(), file)) {
    open_datasets();
    count_rows();
  }

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] const RecordingHeader& header() const noexcept { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const noexcept { return columns_; }
  [[nodiscard]] std::uint64_t rows() const noexcept { return rows_; }

  void refresh() {
    const hdf5::Object root(H5Oopen(file_.get(), "/", H5P_DEFAULT));
    const std::string what = name_ + ": cannot be read again";
    hdf5::checked(H5Orefresh(root.get()), what);
    hdf5::checked(H5Drefresh(events_.get()), what);
    if (overview_) hdf5::checked(H5Drefresh(overview_.get()), what);
    for (const Opened& entry : opened_) hdf5::checked(H5Drefresh(entry.dataset.get()), what);
    hdf5::read_attribute(root.get(), "complete", header_.complete);
    count_rows();
  }

  /// Fills `samples` from row `first` on.
  void read(std::uint64_t first, std::span<Sample> samples, std::span<const std::string_view> names) const {
    std::vector<std::byte> buffer;
    for (std::size_t done = 0; done < samples.size(); done += kReadBlock) {
      const std::span block = samples.subspan(done, std::min<std::size_t>(kReadBlock, samples.size() - done));
      for (const Opened& entry : opened_) {
        if (!names.empty() && std::find(names.begin(), names.end(), entry.column->name) == names.end()) continue;
        buffer.resize(block.size() * entry.column->row_bytes());
        read_column(entry, first + done, block.size(), buffer.data());
        if (&entry == &opened_.front()) check_time(first + done, buffer);
        entry.column->unpack(buffer.data(), block);
      }
    }
  }

  void append_events(std::vector<StoredEvent>& events) const {
    const hsize_t count = hdf5::shape(events_.get())[0];
    check_length(layout::kEvents, count);
    const hdf5::Type type = hdf5::event_type(characters_of_events());
    std::vector<char> rows;
    for (hsize_t first = 0; first < count; first += kReadBlock) {
      const hsize_t block = std::min<hsize_t>(kReadBlock, count - first);
      rows.resize(block * layout::EventRow::kBytes);
      hdf5::read_rows(events_.get(), fmt::format("{}: {}", name_, layout::kEvents), type.get(), first, block,
                      rows.data());
      for (const char* row = rows.data(); row != rows.data() + rows.size(); row += layout::EventRow::kBytes) {
        StoredEvent& event = events.emplace_back();
        std::memcpy(&event.time, row + layout::EventRow::kTime, sizeof event.time);
        std::memcpy(&event.code, row + layout::EventRow::kCode, sizeof event.code);
        event.text.assign(row + layout::EventRow::kText,
                          strnlen(row + layout::EventRow::kText, layout::EventRow::kTextBytes));
        // Rows that were grown into but never written.
        if (std::isnan(event.time)) events.pop_back();
      }
    }
  }

  [[nodiscard]] int deflate() const {
    const hdf5::Dataset position = open("/samples/position");
    const hdf5::Properties creation(H5Dget_create_plist(position.get()));
    std::array<unsigned, 1> level{};
    std::size_t count = level.size();
    unsigned flags = 0, config = 0;
    const herr_t found =
        H5Pget_filter_by_id2(creation.get(), H5Z_FILTER_DEFLATE, &flags, &count, level.data(), 0, nullptr, &config);
    return found >= 0 ? static_cast<int>(level[0]) : 0;
  }

  /// The blocks that the file keeps figures of, as far as they are of rows that are there.
  [[nodiscard]] std::vector<RecordingSummary> stored_overview() const {
    std::vector<RecordingSummary> blocks;
    if (!overview_) return blocks;
    const hdf5::Type type = hdf5::overview_type();
    const std::size_t bytes = H5Tget_size(type.get());
    const hsize_t count = hdf5::shape(overview_.get())[0];
    // Each has a row of the recording at least: more are damage.
    if (count > rows_) return blocks;
    std::vector<std::byte> rows(count * bytes);
    if (count > 0)
      hdf5::read_rows(overview_.get(), fmt::format("{}: {}", name_, layout::kOverview), type.get(), 0, count,
                      rows.data());
    std::uint64_t told = 0;
    for (const std::byte* row = rows.data(); row != rows.data() + rows.size();) {
      RecordingSummary block;
      for (const layout::OverviewField& field : layout::overview_fields()) {
        field.unpack(row, block);
        row += field.bytes();
      }
      if (block.rows == 0 || block.rows > rows_ - told) break;
      told += block.rows;
      blocks.push_back(block);
    }
    return blocks;
  }

 private:
  struct Opened {
    const layout::Column* column;
    hdf5::Dataset dataset;
  };

  void open_datasets() {
    columns_ = hdf5::present_columns(file_.get());
    std::vector<std::string> missing;
    for (const layout::Column& column : layout::columns()) {
      if (!column.in(columns_)) continue;
      hdf5::Dataset dataset = open(column.path());
      if (!dataset) {
        missing.push_back(column.path());
        continue;
      }
      check_dataset(dataset, column, name_);
      opened_.push_back({&column, std::move(dataset)});
    }
    events_ = open(layout::kEvents);
    if (!events_) missing.emplace_back(layout::kEvents);
    if (!missing.empty())
      throw input_error(fmt::format("{}: is not a whole recording: it lacks {}", name_, fmt::join(missing, ", ")));
    const hdf5::Type type(H5Dget_type(events_.get()));
    if (H5Tget_class(type.get()) != H5T_COMPOUND || hdf5::shape(events_.get()).size() != 1)
      throw input_error(fmt::format("{}: {} is not a list of time, code and text", name_, layout::kEvents));

    // Its absence, and any other shape of it, costs time but no data.
    overview_ = open(layout::kOverview);
    if (!overview_) return;
    const hdf5::Type row(H5Dget_type(overview_.get()));
    if (H5Tequal(row.get(), hdf5::overview_type().get()) <= 0 || hdf5::shape(overview_.get()).size() != 1)
      overview_ = hdf5::Dataset{};
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
    rows_ = std::numeric_limits<std::uint64_t>::max();
    for (const Opened& entry : opened_) rows_ = std::min<std::uint64_t>(rows_, hdf5::shape(entry.dataset.get())[0]);
    check_length("/samples/time", rows_);
    // A writer that found the disk full grew its datasets before it failed to fill them; time is filled last.
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

  /// A length that is damaged would be read for hours.
  void check_length(const char* path, std::uint64_t length) const {
    std::error_code error;
    const std::uint64_t bytes = std::filesystem::file_size(name_, error);
    if (error || length / kDensest > bytes / sizeof(double))
      throw input_error(fmt::format("{}: is damaged: {} cannot have {} rows in {} bytes", name_, path, length, bytes));
  }

  void read_column(const Opened& entry, std::uint64_t first, std::uint64_t count, void* values) const {
    hdf5::read_rows(entry.dataset.get(), fmt::format("{}: {}", name_, entry.column->path()),
                    hdf5::stored_type(entry.column->element), first, count, values);
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
  hdf5::File file_;
  RecordingHeader header_;
  RecordingColumns columns_;
  std::vector<Opened> opened_;  ///< time is the first
  hdf5::Dataset events_, overview_;
  std::uint64_t rows_ = 0;
};

RecordingReader::RecordingReader(const std::string& file, Parts which) : which_(which) {
  const hdf5::Silence silence;
  parts_.push_back(std::make_unique<Part>(file));
  open_further_parts();
}

RecordingReader::~RecordingReader() = default;
RecordingReader::RecordingReader(RecordingReader&&) noexcept = default;
RecordingReader& RecordingReader::operator=(RecordingReader&&) noexcept = default;

void RecordingReader::open_further_parts() {
  const Part& first = *parts_.front();
  if (first.header().part != 1 || which_ == Parts::this_file) return;
  for (;;) {
    const auto next = static_cast<std::uint32_t>(parts_.size() + 1);
    const std::string file = part_file(first.name(), next);
    // A part is missing, or another recording's is in its place: the recording ends before it.
    if (!is_hdf5(file)) return;
    auto part = std::make_unique<Part>(file);
    const RecordingHeader& header = part->header();
    if (header.part != next || header.part_of != first.header().part_of) return;
    parts_.push_back(std::move(part));
  }
}

RecordingHeader RecordingReader::header() const {
  RecordingHeader header = parts_.front()->header();
  header.complete = parts_.back()->header().complete;
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
    part->read(first, rest.first(here), names);
    rest = rest.subspan(here);
    first = 0;
  }
  return samples;
}

std::vector<StoredEvent> RecordingReader::events() const {
  const hdf5::Silence silence;
  std::vector<StoredEvent> events;
  for (const auto& part : parts_) part->append_events(events);
  return events;
}

std::vector<RecordingSummary> RecordingReader::overview(const std::function<void(std::uint64_t)>& progress) const {
  const hdf5::Silence silence;
  std::vector<RecordingSummary> blocks;
  std::uint64_t begin = 0;  // of the part
  for (const auto& part : parts_) {
    std::uint64_t row = 0;
    for (RecordingSummary& block : part->stored_overview()) {
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
  std::uint64_t low = 0, high = rows();  // the row is in [low, high), if there is one at all
  while (high - low > 1) {
    const std::uint64_t middle = low + (high - low) / 2;
    if (read(middle, 1, kTime).front().time_ns <= time_ns)
      low = middle;
    else
      high = middle;
  }
  return low;
}

void for_each_block(const RecordingReader& reader, const std::function<void(std::span<const Sample>)>& visit) {
  constexpr std::uint64_t kRows = 8192;
  for (std::uint64_t first = 0; first < reader.rows(); first += kRows) visit(reader.read(first, kRows));
}

bool is_hdf5(const std::string& file) {
  constexpr std::string_view kSignature = "\x89HDF\r\n\x1a\n";
  std::array<char, kSignature.size()> head{};
  std::ifstream(file, std::ios::binary).read(head.data(), head.size());
  return std::string_view(head.data(), head.size()) == kSignature;
}

}  // namespace haptrace
