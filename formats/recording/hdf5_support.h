// HDF5's C interface with ownership, exceptions and without printed errors. Private to formats.
#pragma once

#include "base/error.h"
#include "formats/recording/recording_layout.h"

#include <array>
#include <hdf5.h>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace haptrace::hdf5 {

/// Owns one identifier.
template <auto Close>
class Handle {
 public:
  Handle() = default;
  explicit Handle(hid_t id) : id_(id) {}
  ~Handle() { close(); }
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }

  [[nodiscard]] hid_t get() const noexcept { return id_; }
  explicit operator bool() const noexcept { return id_ >= 0; }

  /// Returns false if HDF5 could not close it.
  bool close() noexcept { return id_ < 0 || Close(std::exchange(id_, H5I_INVALID_HID)) >= 0; }

 private:
  hid_t id_ = H5I_INVALID_HID;
};

using File = Handle<H5Fclose>;
using Dataset = Handle<H5Dclose>;
using Group = Handle<H5Gclose>;
using Object = Handle<H5Oclose>;
using Attribute = Handle<H5Aclose>;
using Type = Handle<H5Tclose>;
using Space = Handle<H5Sclose>;
using Properties = Handle<H5Pclose>;

/// Suppresses HDF5's printed errors in this thread while it lives: our own errors contain the reason.
class Silence {
 public:
  Silence() noexcept {
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~Silence() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

/// Returns why the last call failed, in HDF5's own words: the operating system's reason if there is one, otherwise the
/// innermost entry of the error stack. Every call clears the error of the previous one, including the closing of a
/// handle.
std::string last_error();

/// Returns the result of a call, or throws Error(input) with `what` and HDF5's reason.
template <class Result>
Result checked(Result result, const std::string& what) {
  if (result < 0) throw input_error(what + ": " + last_error());
  return result;
}

/// Returns a string type of `bytes` bytes, including the final zero.
Type text_type(std::size_t bytes, H5T_cset_t characters = H5T_CSET_UTF8);

/// Returns the type of an element in a file, which is the same in memory.
hid_t stored_type(layout::Element element);

/// Returns the type of a row of /events, see layout::EventRow. HDF5 does not convert between character sets, not even
/// from ASCII to UTF-8.
Type event_type(H5T_cset_t characters = H5T_CSET_UTF8);

/// Returns the element type of a dataset of /event_list. It declares texts as ASCII, which every program reads
/// unchanged.
Type event_column_type(const layout::EventColumn& column);

/// Returns the type of a row of /contacts, see layout::ContactRow.
Type contact_type();

/// Returns the type of a row of /overview, see layout::overview_fields().
Type overview_type();

/// Write scalar attributes: create_attribute() a new one, update_attribute() an existing one. Text has a fixed length.
void create_attribute(hid_t object, const char* name, const std::string& text);
void create_attribute(hid_t object, const char* name, double value);
void create_attribute(hid_t object, const char* name, bool value);
void create_attribute(hid_t object, const char* name, std::uint32_t value);
void create_attribute(hid_t object, const char* name, std::uint64_t value);
void update_attribute(hid_t object, const char* name, bool value);
void update_attribute(hid_t object, const char* name, std::uint64_t value);
/// The same for text with room for more: `bytes` in all, including a final zero. An update keeps that size.
void create_attribute(hid_t object, const char* name, const std::string& text, std::size_t bytes);
void update_attribute(hid_t object, const char* name, const std::string& text);

/// Returns the names of an object's attributes, in alphabetical order.
std::vector<std::string> attribute_names(hid_t object);

/// Returns the names of a group's links, in alphabetical order.
std::vector<std::string> link_names(hid_t group);

/// Read a scalar attribute. Return false if it is absent or cannot be converted. Text may have any HDF5 string type.
bool read_attribute(hid_t object, const char* name, std::string& text);
bool read_attribute(hid_t object, const char* name, double& value);
bool read_attribute(hid_t object, const char* name, bool& value);
bool read_attribute(hid_t object, const char* name, std::uint32_t& value);
bool read_attribute(hid_t object, const char* name, std::uint64_t& value);

/// Returns why the target of `path` is not in `file` itself; empty if it is, or if there is no target. HDF5 would
/// follow an external link, and read the rows of a dataset with external storage or of a virtual one from any file that
/// this user can read: for example /etc/passwd into a recording that is then shared.
std::string why_outside(hid_t file, const std::string& path);

/// Returns true if the path, with all its groups, leads to an object of `file`. Throws Error(input) if it leads out.
bool exists(hid_t file, const std::string& path);

/// Open the target of the path; return an invalid handle if there is none. All readers use these functions. Throw
/// Error(input) if the target is not in the file itself.
Dataset open_dataset(hid_t file, const std::string& path);
Object open_object(hid_t file, const std::string& path);

/// Returns the options of which `file` has a column. A file with one of their columns must have all of them.
RecordingColumns present_columns(hid_t file);

/// Returns the dimensions of a dataset.
std::vector<hsize_t> shape(hid_t dataset);

/// Returns the first two parameters of a dataset's filter; nothing without the filter or the dataset.
std::optional<std::array<unsigned, 2>> filter_of(const Dataset& dataset, H5Z_filter_t filter);

/// Returns the decimal places to which the scale-offset filter of a dataset rounds; nothing without the filter.
std::optional<int> decimal_digits(const Dataset& dataset);

/// Returns the rows per chunk of a dataset; 1 if it is not chunked.
std::uint64_t chunk_rows(hid_t dataset);

/// Reads rows [first, first + count) of `path`, open as `dataset`, into `rows` as `type`. Throws Error(input) naming
/// path and rows.
void read_rows(hid_t dataset, const std::string& path, hid_t type, hsize_t first, hsize_t count, void* rows);

/// Returns true if a writer has not closed the file: it is still writing, or was killed.
bool was_left_open(const std::string& file);

/// Returns the length of the file when it was closed, from its superblock [bytes]; nothing for superblocks older than
/// version 2, of HDF5 1.8.
std::optional<std::uint64_t> stored_end(const std::string& file);

/// Opens a file for reading: finished, being written (SWMR), or left by a writer that was killed. `patiently`: data
/// that make no sense may be a writer's unfinished work, and are read again for a while.
/// Throws Error(input) if the file is missing, a folder, empty, not HDF5, open elsewhere for writing without SWMR, or
/// damaged.
File open_to_read(const std::string& file, bool patiently = true);

/// Opens a finished file for writing while others read (SWMR). A file that another program overwrote is an error after
/// a bounded number of attempts; HDF5's own number would block a writer forever. Throws Error(input).
File open_to_write(const std::string& file);

}  // namespace haptrace::hdf5
