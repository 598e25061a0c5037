// HDF5's C interface with owners, errors and silence. Private to formats.
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

  /// False when HDF5 could not.
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

/// While it lives, HDF5 prints nothing about errors in this thread: ours carry them.
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

/// Why the last call failed, in HDF5's own words: the operating system's reason where there is one, else the innermost
/// entry of the error stack. Every call forgets the one before, closing a handle included.
std::string last_error();

/// The result of a call, or an Error(input): `what` and HDF5's reason.
template <class Result>
Result checked(Result result, const std::string& what) {
  if (result < 0) throw input_error(what + ": " + last_error());
  return result;
}

/// A string type of `bytes` bytes, the final zero among them.
Type text_type(std::size_t bytes, H5T_cset_t characters = H5T_CSET_UTF8);

/// How an element lies in a file; the same as in memory.
hid_t stored_type(layout::Element element);

/// A row of /events, see layout::EventRow. HDF5 does not convert between character sets, not even from ASCII to UTF-8.
Type event_type(H5T_cset_t characters = H5T_CSET_UTF8);

/// An element of a dataset of /event_list. Its texts are said to be ASCII, which every program reads as it is.
Type event_column_type(const layout::EventColumn& column);

/// A row of /overview, see layout::overview_fields().
Type overview_type();

/// Writers of a scalar attribute that is new. Text has a fixed length.
void create_attribute(hid_t object, const char* name, const std::string& text);
void create_attribute(hid_t object, const char* name, double value);
void create_attribute(hid_t object, const char* name, bool value);
void create_attribute(hid_t object, const char* name, std::uint32_t value);
void create_attribute(hid_t object, const char* name, std::uint64_t value);
void update_attribute(hid_t object, const char* name, bool value);
void update_attribute(hid_t object, const char* name, std::uint64_t value);
/// Text with room for more: `bytes` in all, a final zero included. Updating one keeps its room.
void create_attribute(hid_t object, const char* name, const std::string& text, std::size_t bytes);
void update_attribute(hid_t object, const char* name, const std::string& text);

/// The names of an object's attributes, in alphabetical order.
std::vector<std::string> attribute_names(hid_t object);

/// The names of what is in a group, in alphabetical order.
std::vector<std::string> link_names(hid_t group);

/// Readers of a scalar attribute: false when it is absent or cannot be converted. Text may have any HDF5 string type.
bool read_attribute(hid_t object, const char* name, std::string& text);
bool read_attribute(hid_t object, const char* name, double& value);
bool read_attribute(hid_t object, const char* name, bool& value);
bool read_attribute(hid_t object, const char* name, std::uint32_t& value);
bool read_attribute(hid_t object, const char* name, std::uint64_t& value);

/// Says why what `path` leads to is not in `file` itself; empty when it is, or when there is nothing. HDF5 would follow
/// an external link, or read the rows of a dataset with external storage or of a virtual one, out of any file that this
/// user can read: out of /etc/passwd into a recording that is then shared.
std::string why_outside(hid_t file, const std::string& path);

/// True when the path leads to an object of `file`, all its groups included. Throws Error(input) when it leads out.
bool exists(hid_t file, const std::string& path);

/// Open what the path leads to; nothing when there is no such thing. Every reader opens by these. Throw Error(input)
/// when it is not in the file itself.
Dataset open_dataset(hid_t file, const std::string& path);
Object open_object(hid_t file, const std::string& path);

/// The options of which `file` has a column. Where it has one, it must have all of them.
RecordingColumns present_columns(hid_t file);

/// The dimensions of a dataset.
std::vector<hsize_t> shape(hid_t dataset);

/// The first numbers of a filter of a dataset; nothing without it, or without the dataset.
std::optional<std::array<unsigned, 2>> filter_of(const Dataset& dataset, H5Z_filter_t filter);

/// The decimal places to which the scale-offset filter of a dataset rounds; nothing when it has none.
std::optional<int> decimal_digits(const Dataset& dataset);

/// How many rows a dataset keeps together; 1 when it is not in chunks.
std::uint64_t chunk_rows(hid_t dataset);

/// Reads rows [first, first + count) of `path`, open as `dataset`, into `rows` as `type`. Throws Error(input) naming
/// path and rows.
void read_rows(hid_t dataset, const std::string& path, hid_t type, hsize_t first, hsize_t count, void* rows);

/// True when a writer has not closed the file: it is at work, or was killed.
bool was_left_open(const std::string& file);

/// How long the file was when it was closed, as its superblock says [bytes]. Nothing in superblocks that are older than
/// version 2, of HDF5 1.8.
std::optional<std::uint64_t> stored_end(const std::string& file);

/// Opens a file to read it: finished, being written by somebody (SWMR), or left by a writer that was killed.
/// `patiently`: what does not make sense may be a writer's unfinished work, and is read again for a while.
/// Throws Error(input): missing, a folder, empty, not HDF5, open elsewhere for writing without SWMR, damaged.
File open_to_read(const std::string& file, bool patiently = true);

/// Opens a finished file to write it while others read (SWMR). What another program scribbled over it is an error after
/// a bounded number of attempts: HDF5's own would keep a writer for ever. Throws Error(input).
File open_to_write(const std::string& file);

}  // namespace haptrace::hdf5
