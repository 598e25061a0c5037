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

constexpr std::uint64_t kBlock = 4096;    // rows
constexpr double kLongestTime = 9.2e9;    // [s]; what 63 bits of nanoseconds hold
constexpr std::uint64_t kDensest = 1100;  // deflate cannot pack bytes closer than 1032 to one

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

struct RecordingReader::File {
  struct Opened {
    const layout::Column* column;
    hdf5::Dataset dataset;
  };

  std::string name;
  hdf5::File file;
  RecordingHeader header;
  RecordingColumns columns;
  std::vector<Opened> opened;  ///< time is the first
  hdf5::Dataset events;
  std::uint64_t rows = 0;

  void open_datasets() {
    columns = hdf5::present_columns(file.get());
    std::vector<std::string> missing;
    for (const layout::Column& column : layout::columns()) {
      if (!column.in(columns)) continue;
      hdf5::Dataset dataset;
      if (hdf5::exists(file.get(), column.path()))
        dataset = hdf5::Dataset(H5Dopen2(file.get(), column.path().c_str(), H5P_DEFAULT));
      if (!dataset) {
        missing.push_back(column.path());
        continue;
      }
      check_dataset(dataset, column, name);
      opened.push_back({&column, std::move(dataset)});
    }
    if (hdf5::exists(file.get(), layout::kEvents))
      events = hdf5::Dataset(H5Dopen2(file.get(), layout::kEvents, H5P_DEFAULT));
    if (!events) missing.emplace_back(layout::kEvents);
    if (!missing.empty())
      throw input_error(fmt::format("{}: is not a whole recording: it lacks {}", name, fmt::join(missing, ", ")));
    const hdf5::Type type(H5Dget_type(events.get()));
    if (H5Tget_class(type.get()) != H5T_COMPOUND || hdf5::shape(events.get()).size() != 1)
      throw input_error(fmt::format("{}: {} is not a list of time, code and text", name, layout::kEvents));
  }

  [[nodiscard]] H5T_cset_t characters_of_events() const {
    const hdf5::Type row(H5Dget_type(events.get()));
    const int text = H5Tget_member_index(row.get(), "text");
    const hdf5::Type type(text < 0 ? H5I_INVALID_HID : H5Tget_member_type(row.get(), static_cast<unsigned>(text)));
    if (!type || H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0)
      throw input_error(fmt::format("{}: {} has no text of fixed length", name, layout::kEvents));
    return H5Tget_cset(type.get());
  }

  void count_rows() {
    rows = std::numeric_limits<std::uint64_t>::max();
    for (const Opened& entry : opened) rows = std::min<std::uint64_t>(rows, hdf5::shape(entry.dataset.get())[0]);
    check_length("/samples/time", rows);
    // A writer that found the disk full grew its datasets before it failed to fill them; time is filled last.
    std::array<double, kBlock> time{};
    while (rows > 0) {
      const std::uint64_t count = std::min(kBlock, rows);
      read_column(opened.front(), rows - count, count, time.data());
      const auto end = time.begin() + static_cast<std::ptrdiff_t>(count);
      const auto last = std::find_if(std::reverse_iterator(end), std::reverse_iterator(time.begin()),
                                     [](double t) { return !std::isnan(t); });
      rows -= static_cast<std::uint64_t>(last - std::reverse_iterator(end));
      if (last.base() != time.begin()) break;
    }
  }

  /// A length that is damaged would be read for hours.
  void check_length(const char* path, std::uint64_t length) const {
    std::error_code error;
    const std::uint64_t bytes = std::filesystem::file_size(name, error);
    if (error || length / kDensest > bytes / sizeof(double))
      throw input_error(fmt::format("{}: is damaged: {} cannot have {} rows in {} bytes", name, path, length, bytes));
  }

  void read_column(const Opened& entry, std::uint64_t first, std::uint64_t count, void* values) const {
    hdf5::read_rows(entry.dataset.get(), fmt::format("{}: {}", name, entry.column->path()),
                    hdf5::stored_type(entry.column->element), first, count, values);
  }

  void read_block(std::uint64_t first, std::span<Sample> samples, std::vector<std::byte>& buffer) const {
    for (const Opened& entry : opened) {
      buffer.resize(samples.size() * entry.column->row_bytes());
      read_column(entry, first, samples.size(), buffer.data());
      if (&entry == &opened.front()) check_time(first, buffer);
      entry.column->unpack(buffer.data(), samples);
    }
  }

  void check_time(std::uint64_t first, const std::vector<std::byte>& buffer) const {
    const std::span time(reinterpret_cast<const double*>(buffer.data()), buffer.size() / sizeof(double));
    const auto bad = std::find_if_not(time.begin(), time.end(), [](double t) { return std::abs(t) < kLongestTime; });
    if (bad != time.end())
      throw input_error(fmt::format("{}: /samples/time[{}] is {}, which is not a time", name,
                                    first + static_cast<std::uint64_t>(bad - time.begin()), *bad));
  }
};

RecordingReader::RecordingReader(const std::string& file) : file_(std::make_unique<File>()) {
  const hdf5::Silence silence;
  file_->name = file;
  file_->file = hdf5::open_to_read(file);
  file_->header = read_header(file_->file.get(), file);
  file_->open_datasets();
  file_->count_rows();
}

RecordingReader::~RecordingReader() = default;
RecordingReader::RecordingReader(RecordingReader&&) noexcept = default;
RecordingReader& RecordingReader::operator=(RecordingReader&&) noexcept = default;

const RecordingHeader& RecordingReader::header() const noexcept {
  return file_->header;
}

const RecordingColumns& RecordingReader::columns() const noexcept {
  return file_->columns;
}

std::uint64_t RecordingReader::rows() const noexcept {
  return file_->rows;
}

void RecordingReader::refresh() {
  const hdf5::Silence silence;
  const hdf5::Object root(H5Oopen(file_->file.get(), "/", H5P_DEFAULT));
  const std::string what = file_->name + ": cannot be read again";
  hdf5::checked(H5Orefresh(root.get()), what);
  hdf5::checked(H5Drefresh(file_->events.get()), what);
  for (const File::Opened& entry : file_->opened) hdf5::checked(H5Drefresh(entry.dataset.get()), what);
  hdf5::read_attribute(root.get(), "complete", file_->header.complete);
  file_->count_rows();
}

std::vector<Sample> RecordingReader::read(std::uint64_t first, std::uint64_t count) const {
  const hdf5::Silence silence;
  first = std::min(first, file_->rows);
  std::vector<Sample> samples(std::min(count, file_->rows - first));
  std::vector<std::byte> buffer;
  for (std::size_t done = 0; done < samples.size(); done += kBlock) {
    const std::size_t block = std::min<std::size_t>(kBlock, samples.size() - done);
    file_->read_block(first + done, std::span(samples).subspan(done, block), buffer);
  }
  return samples;
}

std::vector<StoredEvent> RecordingReader::events() const {
  const hdf5::Silence silence;
  const hsize_t count = hdf5::shape(file_->events.get())[0];
  file_->check_length(layout::kEvents, count);
  const hdf5::Type type = hdf5::event_type(file_->characters_of_events());
  std::vector<StoredEvent> events;
  std::vector<char> rows;
  for (hsize_t first = 0; first < count; first += kBlock) {
    const hsize_t block = std::min<hsize_t>(kBlock, count - first);
    rows.resize(block * layout::EventRow::kBytes);
    hdf5::read_rows(file_->events.get(), fmt::format("{}: {}", file_->name, layout::kEvents), type.get(), first, block,
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
  return events;
}

bool is_hdf5(const std::string& file) {
  constexpr std::string_view kSignature = "\x89HDF\r\n\x1a\n";
  std::array<char, kSignature.size()> head{};
  std::ifstream(file, std::ios::binary).read(head.data(), head.size());
  return std::string_view(head.data(), head.size()) == kSignature;
}

}  // namespace haptrace
