#include "formats/recording/hdf5_support.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <memory>

namespace haptrace::hdf5 {
namespace {

/// Number of attempts to read what a writer has half-written, after 1 ns, 2 ns, 4 ns and so on: for 34 ms in all.
/// HDF5's own 100 attempts would block the reader of a damaged file forever.
constexpr unsigned kReadAttempts = 25;

/// HDF5 1.10 cannot close a file whose disk failed during a flush. It frees the file, keeps its identifier and follows
/// that when the program exits, which would crash after all results are reported. We close every file that we open, so
/// HDF5 need not do so. This only works before the first use of HDF5 in the program.
[[maybe_unused]] const bool kNothingAtExit = H5dont_atexit() >= 0;

Attribute new_attribute(hid_t object, const char* name, hid_t type) {
  const Space scalar(H5Screate(H5S_SCALAR));
  return Attribute(checked(H5Acreate2(object, name, type, scalar.get(), H5P_DEFAULT, H5P_DEFAULT),
                           fmt::format("attribute {} cannot be created", name)));
}

void write(const Attribute& attribute, const char* name, hid_t type, const void* value) {
  checked(H5Awrite(attribute.get(), type, value), fmt::format("attribute {} cannot be written", name));
}

Attribute open_attribute(hid_t object, const char* name) {
  return Attribute(checked(H5Aopen(object, name, H5P_DEFAULT), fmt::format("attribute {} cannot be opened", name)));
}

/// Opens an attribute of one element; returns none if it is absent or has another shape.
Attribute open_scalar(hid_t object, const char* name) {
  if (H5Aexists(object, name) <= 0) return {};
  Attribute attribute(H5Aopen(object, name, H5P_DEFAULT));
  if (!attribute) return {};
  const Space space(H5Aget_space(attribute.get()));
  return H5Sget_simple_extent_npoints(space.get()) == 1 ? std::move(attribute) : Attribute{};
}

H5T_class_t class_of(const Attribute& attribute) {
  const Type type(H5Aget_type(attribute.get()));
  return H5Tget_class(type.get());
}

/// Opens a file. If that fails, `reason` states why.
File try_open(const std::string& file, unsigned flags, std::string& reason, unsigned attempts = kReadAttempts) {
  const Properties access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  if ((flags & (H5F_ACC_SWMR_READ | H5F_ACC_SWMR_WRITE)) != 0) {
    H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110);
    H5Pset_metadata_read_attempts(access.get(), attempts);
  }
  File opened(H5Fopen(file.c_str(), flags, access.get()));
  if (!opened) reason = last_error();
  return opened;
}

}  // namespace

std::string last_error() {
  std::string reason;
  const auto take_innermost = [](unsigned depth, const H5E_error2_t* error, void* data) -> herr_t {
    if (depth == 0 && error->desc != nullptr) *static_cast<std::string*>(data) = error->desc;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take_innermost, &reason);

  constexpr std::string_view kSystem = "error message = '";
  if (const auto at = reason.find(kSystem); at != std::string::npos) {
    const std::size_t begin = at + kSystem.size();
    return reason.substr(begin, reason.find('\'', begin) - begin);
  }
  return reason.empty() ? "HDF5 gives no reason" : reason;
}

Type text_type(std::size_t bytes, H5T_cset_t characters) {
  Type type(H5Tcopy(H5T_C_S1));
  H5Tset_size(type.get(), bytes);
  H5Tset_cset(type.get(), characters);
  H5Tset_strpad(type.get(), H5T_STR_NULLTERM);
  return type;
}

hid_t stored_type(layout::Element element) {
  switch (element) {
    case layout::Element::float64:
      return H5T_IEEE_F64LE;
    case layout::Element::float32:
      return H5T_IEEE_F32LE;
    case layout::Element::uint64:
      return H5T_STD_U64LE;
    case layout::Element::uint32:
      return H5T_STD_U32LE;
    case layout::Element::uint8:
      return H5T_STD_U8LE;
  }
  return H5I_INVALID_HID;
}

Type event_type(H5T_cset_t characters) {
  Type type(H5Tcreate(H5T_COMPOUND, layout::EventRow::kBytes));
  H5Tinsert(type.get(), "time", layout::EventRow::kTime, H5T_IEEE_F64LE);
  H5Tinsert(type.get(), "code", layout::EventRow::kCode, H5T_STD_I32LE);
  H5Tinsert(type.get(), "text", layout::EventRow::kText, text_type(layout::EventRow::kTextBytes, characters).get());
  return type;
}

Type event_column_type(const layout::EventColumn& column) {
  if (column.bytes > sizeof(double)) return text_type(column.bytes, H5T_CSET_ASCII);
  return Type(H5Tcopy(column.bytes == sizeof(double) ? H5T_IEEE_F64LE : H5T_STD_I32LE));
}

Type contact_type() {
  using Row = layout::ContactRow;
  Type type(H5Tcreate(H5T_COMPOUND, Row::kBytes));
  const hsize_t width = 3;
  const Type vector(H5Tarray_create2(H5T_IEEE_F64LE, 1, &width));
  H5Tinsert(type.get(), "time", Row::kTime, H5T_IEEE_F64LE);
  H5Tinsert(type.get(), "tick", Row::kTick, H5T_STD_U64LE);
  H5Tinsert(type.get(), "object", Row::kObject, H5T_STD_U32LE);
  H5Tinsert(type.get(), "proxy", Row::kProxy, vector.get());
  H5Tinsert(type.get(), "normal", Row::kNormal, vector.get());
  H5Tinsert(type.get(), "depth", Row::kDepth, H5T_IEEE_F64LE);
  H5Tinsert(type.get(), "force", Row::kForce, vector.get());
  return type;
}

Type overview_type() {
  std::size_t bytes = 0;
  for (const layout::OverviewField& field : layout::overview_fields()) bytes += field.bytes();
  Type row(H5Tcreate(H5T_COMPOUND, bytes));
  std::size_t offset = 0;
  for (const layout::OverviewField& field : layout::overview_fields()) {
    const hid_t number = field.floating ? H5T_IEEE_F64LE : H5T_STD_U64LE;
    const hsize_t width = field.width;
    const Type vector(field.width > 1 ? H5Tarray_create2(number, 1, &width) : H5Tcopy(number));
    H5Tinsert(row.get(), field.name, offset, vector.get());
    offset += field.bytes();
  }
  return row;
}

void create_attribute(hid_t object, const char* name, const std::string& text) {
  create_attribute(object, name, text, text.size() + 1);
}

void create_attribute(hid_t object, const char* name, const std::string& text, std::size_t bytes) {
  const Type type = text_type(bytes);
  std::string padded = text;
  padded.resize(bytes, '\0');
  write(new_attribute(object, name, type.get()), name, type.get(), padded.c_str());
}

void create_attribute(hid_t object, const char* name, double value) {
  write(new_attribute(object, name, H5T_IEEE_F64LE), name, H5T_NATIVE_DOUBLE, &value);
}

void create_attribute(hid_t object, const char* name, bool value) {
  const std::uint8_t byte = value ? 1 : 0;
  write(new_attribute(object, name, H5T_STD_U8LE), name, H5T_NATIVE_UINT8, &byte);
}

void create_attribute(hid_t object, const char* name, std::uint32_t value) {
  write(new_attribute(object, name, H5T_STD_U32LE), name, H5T_NATIVE_UINT32, &value);
}

void create_attribute(hid_t object, const char* name, std::uint64_t value) {
  write(new_attribute(object, name, H5T_STD_U64LE), name, H5T_NATIVE_UINT64, &value);
}

void update_attribute(hid_t object, const char* name, bool value) {
  const std::uint8_t byte = value ? 1 : 0;
  write(open_attribute(object, name), name, H5T_NATIVE_UINT8, &byte);
}

void update_attribute(hid_t object, const char* name, std::uint64_t value) {
  write(open_attribute(object, name), name, H5T_NATIVE_UINT64, &value);
}

void update_attribute(hid_t object, const char* name, const std::string& text) {
  const Attribute attribute = open_attribute(object, name);
  const Type type(H5Aget_type(attribute.get()));
  std::string padded = text;
  padded.resize(H5Tget_size(type.get()), '\0');
  write(attribute, name, type.get(), padded.c_str());
}

bool read_attribute(hid_t object, const char* name, std::string& text) {
  const Attribute attribute = open_scalar(object, name);
  if (!attribute || class_of(attribute) != H5T_STRING) return false;
  const Type stored(H5Aget_type(attribute.get()));
  if (H5Tis_variable_str(stored.get()) > 0) {
    char* allocated = nullptr;
    if (H5Aread(attribute.get(), stored.get(), &allocated) < 0) return false;
    text = allocated != nullptr ? allocated : "";
    H5free_memory(allocated);
    return true;
  }
  const std::size_t bytes = H5Tget_size(stored.get());
  if (bytes == 0 || bytes > std::size_t{1} << 24U) return false;
  std::vector<char> buffer(bytes + 1, '\0');
  if (H5Aread(attribute.get(), stored.get(), buffer.data()) < 0) return false;
  text.assign(buffer.data());
  if (H5Tget_strpad(stored.get()) == H5T_STR_SPACEPAD) text.erase(text.find_last_not_of(' ') + 1);
  return true;
}

bool read_attribute(hid_t object, const char* name, double& value) {
  const Attribute attribute = open_scalar(object, name);
  if (!attribute) return false;
  const H5T_class_t type = class_of(attribute);
  return (type == H5T_FLOAT || type == H5T_INTEGER) && H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, &value) >= 0;
}

bool read_attribute(hid_t object, const char* name, bool& value) {
  const Attribute attribute = open_scalar(object, name);
  std::int64_t number = 0;
  if (!attribute || class_of(attribute) != H5T_INTEGER || H5Aread(attribute.get(), H5T_NATIVE_INT64, &number) < 0)
    return false;
  value = number != 0;
  return true;
}

bool read_attribute(hid_t object, const char* name, std::uint32_t& value) {
  const Attribute attribute = open_scalar(object, name);
  return attribute && class_of(attribute) == H5T_INTEGER && H5Aread(attribute.get(), H5T_NATIVE_UINT32, &value) >= 0;
}

bool read_attribute(hid_t object, const char* name, std::uint64_t& value) {
  const Attribute attribute = open_scalar(object, name);
  return attribute && class_of(attribute) == H5T_INTEGER && H5Aread(attribute.get(), H5T_NATIVE_UINT64, &value) >= 0;
}

std::vector<std::string> attribute_names(hid_t object) {
  std::vector<std::string> names;
  const auto take = [](hid_t, const char* name, const H5A_info_t*, void* data) -> herr_t {
    static_cast<std::vector<std::string>*>(data)->emplace_back(name);
    return 0;
  };
  H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_INC, nullptr, take, &names);
  return names;
}

std::vector<std::string> link_names(hid_t group) {
  std::vector<std::string> names;
  const auto take = [](hid_t, const char* name, const H5L_info_t*, void* data) -> herr_t {
    static_cast<std::vector<std::string>*>(data)->emplace_back(name);
    return 0;
  };
  H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, take, &names);
  return names;
}

namespace {

constexpr int kMostSoftLinks = 16;          // in a chain
constexpr std::size_t kLongestLink = 4096;  // bytes

/// Returns the path without soft links; empty if it leads nowhere. `outside` states why if it leads out of the file.
std::string resolved(hid_t file, const std::string& path, std::string& outside, int soft_links = 0) {
  for (std::size_t slash = path.find('/', 1);; slash = path.find('/', slash + 1)) {
    const std::string part = path.substr(0, slash);
    if (H5Lexists(file, part.c_str(), H5P_DEFAULT) <= 0) return {};
    H5L_info_t link{};
    if (H5Lget_info(file, part.c_str(), &link, H5P_DEFAULT) < 0) return {};
    if (link.type == H5L_TYPE_SOFT) {
      std::string target(std::min(link.u.val_size, kLongestLink), '\0');
      if (soft_links == kMostSoftLinks || H5Lget_val(file, part.c_str(), target.data(), target.size(), H5P_DEFAULT) < 0)
        return {};
      target.resize(std::min(target.size(), target.find('\0')));
      if (!target.starts_with('/')) target.insert(0, part, 0, part.rfind('/') + 1);
      return resolved(file, slash == std::string::npos ? target : target + path.substr(slash), outside, soft_links + 1);
    }
    if (link.type != H5L_TYPE_HARD) {
      outside = fmt::format("{} is a link to another file", part);
      return {};
    }
    if (slash == std::string::npos) return H5Oexists_by_name(file, path.c_str(), H5P_DEFAULT) > 0 ? path : "";
  }
}

std::string why_outside(hid_t dataset) {
  const Properties creation(H5Dget_create_plist(dataset));
  if (H5Pget_external_count(creation.get()) > 0) return "its rows lie in another file (external storage)";
  if (H5Pget_layout(creation.get()) == H5D_VIRTUAL) return "its rows lie in other datasets (a virtual dataset)";
  return {};
}

void require_inside(hid_t file, const std::string& path, const std::string& outside) {
  if (outside.empty()) return;
  std::array<char, 4096> name{};
  H5Fget_name(file, name.data(), name.size());
  throw input_error(
      fmt::format("{}: {}: {}; haptrace does not read data outside the file", name.data(), path, outside));
}

/// Resolves the path. Throws if it leads out of the file.
std::string resolved_inside(hid_t file, const std::string& path) {
  std::string outside;
  std::string inside = resolved(file, path, outside);
  require_inside(file, path, outside);
  return inside;
}

}  // namespace

std::string why_outside(hid_t file, const std::string& path) {
  std::string outside;
  const std::string inside = resolved(file, path, outside);
  if (inside.empty()) return outside;
  const Object object(H5Oopen(file, inside.c_str(), H5P_DEFAULT));
  return object && H5Iget_type(object.get()) == H5I_DATASET ? why_outside(object.get()) : "";
}

bool exists(hid_t file, const std::string& path) {
  return !resolved_inside(file, path).empty();
}

Dataset open_dataset(hid_t file, const std::string& path) {
  const std::string inside = resolved_inside(file, path);
  if (inside.empty()) return {};
  Dataset dataset(H5Dopen2(file, inside.c_str(), H5P_DEFAULT));
  if (!dataset) return {};
  require_inside(file, path, why_outside(dataset.get()));
  return dataset;
}

Object open_object(hid_t file, const std::string& path) {
  const std::string inside = resolved_inside(file, path);
  return inside.empty() ? Object{} : Object(H5Oopen(file, inside.c_str(), H5P_DEFAULT));
}

RecordingColumns present_columns(hid_t file) {
  RecordingColumns columns;
  for (const layout::Column& column : layout::columns())
    if (column.option != nullptr && exists(file, column.path())) columns.*column.option = true;
  columns.contacts = exists(file, layout::kContacts);
  return columns;
}

std::vector<hsize_t> shape(hid_t dataset) {
  const Space space(H5Dget_space(dataset));
  std::vector<hsize_t> dimensions(static_cast<std::size_t>(std::max(H5Sget_simple_extent_ndims(space.get()), 0)));
  H5Sget_simple_extent_dims(space.get(), dimensions.data(), nullptr);
  return dimensions;
}

std::optional<std::array<unsigned, 2>> filter_of(const Dataset& dataset, H5Z_filter_t filter) {
  if (!dataset) return std::nullopt;
  const Properties creation(H5Dget_create_plist(dataset.get()));
  std::array<unsigned, 2> numbers{};
  std::size_t count = numbers.size();
  unsigned flags = 0, config = 0;
  if (H5Pget_filter_by_id2(creation.get(), filter, &flags, &count, numbers.data(), 0, nullptr, &config) < 0)
    return std::nullopt;
  return numbers;
}

std::optional<int> decimal_digits(const Dataset& dataset) {
  const auto numbers = filter_of(dataset, H5Z_FILTER_SCALEOFFSET);
  return numbers ? std::optional(static_cast<int>(numbers->back())) : std::nullopt;
}

void read_rows(hid_t dataset, const std::string& path, hid_t type, hsize_t first, hsize_t count, void* rows) {
  std::vector<hsize_t> extent = shape(dataset);
  std::vector<hsize_t> start(extent.size(), 0);
  start.at(0) = first;
  extent[0] = count;
  const std::string what = fmt::format("{} cannot be read at rows {} to {}", path, first, first + count - 1);
  const Space memory(checked(H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr), what));
  const Space disk(checked(H5Dget_space(dataset), what));
  checked(H5Sselect_hyperslab(disk.get(), H5S_SELECT_SET, start.data(), nullptr, extent.data(), nullptr), what);
  checked(H5Dread(dataset, type, memory.get(), disk.get(), H5P_DEFAULT, rows), what);
}

std::uint64_t chunk_rows(hid_t dataset) {
  const Properties creation(H5Dget_create_plist(dataset));
  std::array<hsize_t, H5S_MAX_RANK> chunk{};
  if (H5Pget_layout(creation.get()) != H5D_CHUNKED ||
      H5Pget_chunk(creation.get(), static_cast<int>(chunk.size()), chunk.data()) < 1)
    return 1;
  return std::max<hsize_t>(chunk[0], 1);
}

/// Reads the mark of a writer in a superblock of version 3, which SWMR needs: the byte after the signature, the version
/// and two sizes (HDF5 File Format Specification, II.A).
bool was_left_open(const std::string& file) {
  std::array<char, 12> head{};
  std::ifstream(file, std::ios::binary).read(head.data(), head.size());
  return head[8] >= 3 && head[11] != 0;
}

std::optional<std::uint64_t> stored_end(const std::string& file) {
  constexpr std::size_t kVersion = 8, kSizeOfOffsets = 9, kBase = 12, kEnd = 28;
  std::array<char, kEnd + 8> head{};
  if (!std::ifstream(file, std::ios::binary).read(head.data(), head.size())) return std::nullopt;
  std::uint64_t base = 0, end = 0;
  std::memcpy(&base, head.data() + kBase, sizeof base);
  std::memcpy(&end, head.data() + kEnd, sizeof end);
  if (head[kVersion] < 2 || head[kVersion] > 3 || head[kSizeOfOffsets] != 8 || base != 0) return std::nullopt;
  return end;
}

File open_to_read(const std::string& file, bool patiently) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw input_error(file + ": no such file");
  if (fs::is_directory(status)) throw input_error(file + ": is a folder, not a recording");
  if (!fs::is_regular_file(status)) throw input_error(file + ": is not a regular file");
  if (fs::file_size(file, error) == 0) throw input_error(file + ": is empty");
  if (!is_hdf5(file)) throw input_error(file + ": is not an HDF5 file");

  std::string reason, ignored;
  if (File opened = try_open(file, H5F_ACC_RDONLY, reason)) return opened;
  // If a writer is at work or was killed, its mark in the superblock admits only SWMR readers.
  if (was_left_open(file))
    if (File opened = try_open(file, H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, ignored, patiently ? kReadAttempts : 1))
      return opened;
  if (reason == std::strerror(EAGAIN))
    throw input_error(file + ": is open for writing in another program; close it there first");
  const std::uint64_t bytes = fs::file_size(file, error);
  if (const auto whole = stored_end(file); whole && bytes < *whole)
    throw input_error(fmt::format(
        "{}: is cut off: it has {} of {} bytes. Copy it again, or save the remaining data with haptrace recover", file,
        bytes, *whole));
  throw input_error(fmt::format("{}: HDF5 cannot open it: {}", file, reason));
}

File open_to_write(const std::string& file) {
  std::string reason;
  if (File opened = try_open(file, H5F_ACC_RDWR | H5F_ACC_SWMR_WRITE, reason)) return opened;
  throw input_error("cannot be opened to live readers: " + reason);
}

}  // namespace haptrace::hdf5
