#include "formats/volume/volume_file.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/text_file.h"
#include "base/units.h"
#include "formats/volume/value_source.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <map>
#include <memory>
#include <numbers>
#include <zlib.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

constexpr double kHuge = 3, kTiny = 1e-3;  // sizes that suggest another unit [m]
constexpr double kFarthest = 1e6;          // coordinates [m]
constexpr double kFlat = 1e-6;             // volume of a cell over that of the box of its sides: the axes span no space
constexpr double kSkew = 1e-3;             // cosine between axes from which on a note states the angle
constexpr std::size_t kLongestHeader = 1U << 20U;

/// Layout and place of a volume, as its header states them.
struct Header {
  std::vector<std::uint64_t> sizes;
  Vec3 origin = Vec3::Zero();  // in `unit`, as the steps
  Eigen::Matrix3d steps = Eigen::Matrix3d::Identity();
  std::string unit;  // empty: not stated
  ValueSource source;
};

/// Names of the types in files; the first name of a type is the one for messages.
struct TypeName {
  std::string_view name;
  ValueType type;
};
constexpr std::array kTypeNames{
    TypeName{"int8", ValueType::int8},
    TypeName{"uint8", ValueType::uint8},
    TypeName{"int16", ValueType::int16},
    TypeName{"uint16", ValueType::uint16},
    TypeName{"int32", ValueType::int32},
    TypeName{"uint32", ValueType::uint32},
    TypeName{"float", ValueType::float32},
    TypeName{"double", ValueType::float64},
    TypeName{"signed char", ValueType::int8},
    TypeName{"int8_t", ValueType::int8},
    TypeName{"uchar", ValueType::uint8},
    TypeName{"unsigned char", ValueType::uint8},
    TypeName{"uint8_t", ValueType::uint8},
    TypeName{"short", ValueType::int16},
    TypeName{"short int", ValueType::int16},
    TypeName{"signed short", ValueType::int16},
    TypeName{"signed short int", ValueType::int16},
    TypeName{"int16_t", ValueType::int16},
    TypeName{"ushort", ValueType::uint16},
    TypeName{"unsigned short", ValueType::uint16},
    TypeName{"unsigned short int", ValueType::uint16},
    TypeName{"uint16_t", ValueType::uint16},
    TypeName{"int", ValueType::int32},
    TypeName{"signed int", ValueType::int32},
    TypeName{"int32_t", ValueType::int32},
    TypeName{"uint", ValueType::uint32},
    TypeName{"unsigned int", ValueType::uint32},
    TypeName{"uint32_t", ValueType::uint32},
};
constexpr std::size_t kMainTypes = 8;

std::vector<std::string> type_names() {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < kMainTypes; ++i) names.emplace_back(kTypeNames[i].name);
  return names;
}

const TypeName* find_type(std::string_view name) {
  const auto found = std::find_if(kTypeNames.begin(), kTypeNames.end(), [&](const auto& t) { return t.name == name; });
  return found == kTypeNames.end() ? nullptr : &*found;
}

// --- NRRD ---

/// A header of an NRRD file: lines of "field: value".
class NrrdHeader {
 public:
  explicit NrrdHeader(const std::string& file) : file_(file) {
    std::ifstream stream(file, std::ios::binary);
    if (!stream) throw input_error(fmt::format("{}: cannot be read: {}", file, std::strerror(errno)));
    std::string line;
    for (int number = 1; next_line(stream, line); ++number) {
      if (number == 1) {
        if (!line.starts_with("NRRD000"))
          throw input_error(file + ": does not begin with 'NRRD000', so it is no NRRD file");
        continue;
      }
      if (line.empty()) break;
      if (line.starts_with('#')) continue;
      const std::size_t colon = line.find(':');
      if (colon == std::string::npos)
        throw input_error(fmt::format("{}: line {}: '{}' is no 'field: value'", file, number, shown(line)));
      if (line.substr(colon).starts_with(":=")) continue;  // a key of the user
      std::string key(trim(lower_case(line.substr(0, colon))));
      std::erase(key, ' ');
      if (key == "centers") key = "centerings";
      if (!fields_.emplace(key, Field{std::string(trim(std::string_view(line).substr(colon + 1))), number}).second)
        throw input_error(fmt::format("{}: line {}: '{}' is there twice", file, number, shown(key)));
    }
  }

  /// Returns the offset of what follows the header's blank line [bytes].
  [[nodiscard]] std::uint64_t length() const noexcept { return length_; }

  [[nodiscard]] bool has(const std::string& key) const { return fields_.contains(key); }
  /// Returns the text of a field without blanks in its name; empty: it is absent.
  [[nodiscard]] std::string text(const std::string& key) const {
    return has(key) ? fields_.at(key).text : std::string();
  }
  [[nodiscard]] const std::string& require(const std::string& key, const char* shown_key) const {
    if (!has(key)) throw input_error(fmt::format("{}: the header has no field '{}'", file_, shown_key));
    return fields_.at(key).text;
  }
  /// Returns an error at the line of a field.
  [[nodiscard]] Error error(const std::string& key, const std::string& what) const {
    return input_error(fmt::format("{}: line {}: {}", file_, fields_.at(key).line, what));
  }
  /// Returns the numbers of a field, which are separated by blanks.
  [[nodiscard]] std::vector<double> numbers(const std::string& key) const {
    std::vector<double> numbers;
    std::string_view rest = fields_.at(key).text;
    while (!(rest = trim(rest)).empty()) {
      const std::string_view word = rest.substr(0, rest.find_first_of(" \t"));
      double number = 0;
      if (!parse_number(word, number)) throw error(key, fmt::format("'{}' is not a number", shown(word)));
      numbers.push_back(number);
      rest.remove_prefix(word.size());
    }
    return numbers;
  }
  [[nodiscard]] std::uint64_t whole(const std::string& key, std::uint64_t most) const {
    const std::vector<double> list = numbers(key);
    if (list.size() != 1 || !(list[0] >= 0 && list[0] <= static_cast<double>(most)) || list[0] != std::floor(list[0]))
      throw error(key, fmt::format("expected a whole number from 0 to {}", most));
    return static_cast<std::uint64_t>(list[0]);
  }
  /// Returns vectors "(x,y,z)"; "none" is NaN.
  [[nodiscard]] std::vector<Vec3> vectors(const std::string& key) const {
    std::vector<Vec3> vectors;
    std::string_view rest = fields_.at(key).text;
    while (!(rest = trim(rest)).empty()) {
      if (rest.starts_with("none")) {
        vectors.push_back(nan3());
        rest.remove_prefix(4);
        continue;
      }
      const std::size_t end = rest.find(')');
      if (!rest.starts_with('(') || end == std::string_view::npos)
        throw error(key, fmt::format("'{}' is no vector (x,y,z)", shown(rest)));
      std::string_view inner = rest.substr(1, end - 1);
      Vec3 vector;
      for (int axis = 0; axis < 3; ++axis) {
        const std::size_t comma = inner.find(',');
        if ((comma == std::string_view::npos) != (axis == 2) ||
            !parse_number(trim(inner.substr(0, comma)), vector[axis]))
          throw error(key, fmt::format("'{}' is no vector of three numbers", shown(rest.substr(0, end + 1))));
        if (axis < 2) inner.remove_prefix(comma + 1);
      }
      vectors.push_back(vector);
      rest.remove_prefix(end + 1);
    }
    return vectors;
  }
  /// Returns texts in quotation marks.
  [[nodiscard]] std::vector<std::string> quoted(const std::string& key) const {
    std::vector<std::string> texts;
    std::string_view rest = fields_.at(key).text;
    while (!(rest = trim(rest)).empty()) {
      const std::size_t end = rest.find('"', 1);
      if (!rest.starts_with('"') || end == std::string_view::npos)
        throw error(key, fmt::format("'{}' is no text in quotation marks", shown(rest)));
      texts.emplace_back(rest.substr(1, end - 1));
      rest.remove_prefix(end + 1);
    }
    return texts;
  }

 private:
  struct Field {
    std::string text;
    int line = 0;
  };

  bool next_line(std::istream& stream, std::string& line) {
    line.clear();
    for (int c = stream.get(); c != EOF; c = stream.get()) {
      if (++length_ > kLongestHeader) throw input_error(file_ + ": its header is longer than 1 MiB");
      if (c == '\n') {
        if (line.ends_with('\r')) line.pop_back();
        return true;
      }
      line += static_cast<char>(c);
    }
    return !line.empty();
  }

  std::string file_;
  std::map<std::string, Field> fields_;
  std::uint64_t length_ = 0;
};

/// Returns the offset after `lines` line ends.
std::uint64_t after_lines(const std::string& file, std::uint64_t begin, std::uint64_t lines) {
  std::ifstream stream(file, std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(begin));
  for (std::uint64_t line = 0; line < lines; ++begin) {
    const int c = stream.get();
    if (c == EOF) throw input_error(fmt::format("{}: ends before the {} lines that are to be skipped", file, lines));
    line += c == '\n' ? 1 : 0;
  }
  return begin;
}

/// Returns the unit of all axes that state one; empty if none does.
std::string unit_of_axes(const NrrdHeader& header, const std::string& key) {
  std::string unit;
  for (const std::string& own : header.quoted(key)) {
    if (own.empty() || own == "???" || own == "none") continue;
    if (!unit.empty() && own != unit)
      throw header.error(key, "the axes have different units; convert the file to one unit");
    unit = own;
  }
  return unit;
}

void read_nrrd_place(const NrrdHeader& nrrd, Header& header, std::vector<std::string>& remarks) {
  if (nrrd.has("spacedirections")) {
    const std::vector<Vec3> directions = nrrd.vectors("spacedirections");
    if (directions.size() != 3 ||
        std::any_of(directions.begin(), directions.end(), [](const Vec3& direction) { return !is_finite(direction); }))
      throw nrrd.error("spacedirections", "expected a direction (x,y,z) for each of the three axes");
    for (int axis = 0; axis < 3; ++axis) header.steps.col(axis) = directions[static_cast<std::size_t>(axis)];
    if (nrrd.has("spaceorigin")) {
      const std::vector<Vec3> origin = nrrd.vectors("spaceorigin");
      if (origin.size() != 1) throw nrrd.error("spaceorigin", "expected one place (x,y,z)");
      header.origin = origin[0];
    }
    if (nrrd.has("spaceunits")) header.unit = unit_of_axes(nrrd, "spaceunits");
    const std::string space = lower_case(nrrd.text("space"));
    const bool flips_x = space.starts_with("left-posterior-superior") || space == "lps" ||
                         space.starts_with("left-anterior-superior") || space == "las";
    const bool flips_y = space.starts_with("left-posterior-superior") || space == "lps";
    for (const auto& [flips, axis] : {std::pair(flips_x, 0), std::pair(flips_y, 1)})
      if (flips) {
        header.steps.row(axis) *= -1;
        header.origin[axis] *= -1;
      }
    if (flips_x)
      remarks.push_back(
          fmt::format("its coordinates were turned from {} to right-anterior-superior, as in NIfTI files", space));
    return;
  }
  Vec3 spacing = Vec3::Ones();
  for (const char* key : {"spacings", "axismins"}) {
    if (!nrrd.has(key)) continue;
    const std::vector<double> numbers = nrrd.numbers(key);
    if (numbers.size() != 3) throw nrrd.error(key, "expected a number for each of the three axes");
    for (int axis = 0; axis < 3; ++axis) {
      const double number = numbers[static_cast<std::size_t>(axis)];
      if (key == std::string("spacings")) {
        spacing[axis] = std::isnan(number) ? 1 : number;
      } else if (std::isfinite(number)) {
        // The least coordinate of an axis is that of its first cell's border, unless its samples are nodes.
        const bool nodes = nrrd.text("centerings").find("node") != std::string::npos;
        header.origin[axis] = number + (nodes ? 0 : 0.5 * spacing[axis]);
      }
    }
  }
  header.steps = spacing.asDiagonal();
  if (nrrd.has("units")) header.unit = unit_of_axes(nrrd, "units");
}

void read_nrrd_sizes(const NrrdHeader& nrrd, Header& header) {
  (void)nrrd.require("dimension", "dimension");
  const std::uint64_t dimension = nrrd.whole("dimension", 16);
  if (dimension != 3)
    throw nrrd.error("dimension",
                     fmt::format("a volume has 3 axes, this file {}; extract one volume of it", dimension));
  (void)nrrd.require("sizes", "sizes");
  for (const double size : nrrd.numbers("sizes")) {
    if (!(size >= 1 && size < 1e18) || size != std::floor(size))
      throw nrrd.error("sizes", fmt::format("{} is not a number of samples", size));
    header.sizes.push_back(static_cast<std::uint64_t>(size));
  }
}

ValueType nrrd_type(const NrrdHeader& nrrd) {
  const std::string type(trim(lower_case(nrrd.require("type", "type"))));
  const TypeName* const known = find_type(type);
  if (known == nullptr)
    throw nrrd.error(
        "type", fmt::format("type '{}' is not known; convert it to {}", shown(type), fmt::join(type_names(), ", ")));
  return known->type;
}

void read_nrrd_encoding(const NrrdHeader& nrrd, ValueSource& source) {
  const std::string encoding(trim(lower_case(nrrd.require("encoding", "encoding"))));
  if (encoding == "raw")
    source.encoding = ValueSource::Encoding::raw;
  else if (encoding == "gzip" || encoding == "gz")
    source.encoding = ValueSource::Encoding::gzip;
  else if (encoding == "ascii" || encoding == "txt" || encoding == "text")
    source.encoding = ValueSource::Encoding::text;
  else
    throw nrrd.error("encoding",
                     fmt::format("encoding '{}' is not known; convert it to raw, gzip or ascii", shown(encoding)));
  if (source.encoding != ValueSource::Encoding::text && bytes_of(source.type) > 1) {
    const std::string endian(trim(lower_case(nrrd.require("endian", "endian"))));
    if (endian != "little" && endian != "big") throw nrrd.error("endian", "expected little or big");
    source.big_endian = endian == "big";
  }
}

/// Returns the file of the values, which stands beside the header; empty if they follow the header.
std::string nrrd_data_file(const NrrdHeader& nrrd, const std::string& file) {
  if (!nrrd.has("datafile")) return {};
  const std::string name = nrrd.text("datafile");
  if (name.empty() || name.starts_with("LIST") || name.find('%') != std::string::npos)
    throw nrrd.error("datafile", "the values are in several files; join them into one");
  return (fs::path(file).parent_path() / name).string();
}

/// Skips the lines and bytes before the values.
void skip_to_nrrd_values(const NrrdHeader& nrrd, Header& header) {
  ValueSource& source = header.source;
  constexpr std::uint64_t kMostSkipped = std::uint64_t{1} << 40U;
  if (nrrd.has("lineskip")) source.begin = after_lines(source.file, source.begin, nrrd.whole("lineskip", kMostSkipped));
  if (!nrrd.has("byteskip")) return;
  if (nrrd.text("byteskip") != "-1") {
    source.skip = nrrd.whole("byteskip", kMostSkipped);
    return;
  }
  // The values are the last bytes of the file.
  if (source.encoding != ValueSource::Encoding::raw)
    throw nrrd.error("byteskip", "-1 is possible only with encoding raw");
  std::uint64_t bytes = bytes_of(source.type);
  for (const std::uint64_t size : header.sizes) bytes = size > kMostVoxels ? 0 : bytes * size;
  std::error_code error;
  const std::uintmax_t length = fs::file_size(source.file, error);
  if (!error && length >= bytes) source.begin = length - bytes;
}

Header read_nrrd(const std::string& file, std::string& data_file, std::vector<std::string>& remarks) {
  const NrrdHeader nrrd(file);
  Header header;
  ValueSource& source = header.source;
  read_nrrd_sizes(nrrd, header);
  source.type = nrrd_type(nrrd);
  read_nrrd_place(nrrd, header, remarks);
  read_nrrd_encoding(nrrd, source);
  if (const std::string other = nrrd_data_file(nrrd, file); !other.empty()) {
    data_file = source.file = other;
  } else {
    source.file = file;
    source.begin = nrrd.length();
  }
  skip_to_nrrd_values(nrrd, header);
  return header;
}

// --- NIfTI-1 ---

/// The fixed header of a NIfTI-1 file, of one endianness.
class NiftiHeader {
 public:
  static constexpr std::size_t kLength = 348;

  explicit NiftiHeader(const std::string& file) {
    std::unique_ptr<gzFile_s, void (*)(gzFile)> stream(gzopen(file.c_str(), "rb"),
                                                       [](gzFile own) { (void)gzclose(own); });
    if (!stream) throw input_error(fmt::format("{}: cannot be read: {}", file, std::strerror(errno)));
    if (gzread(stream.get(), bytes_.data(), kLength) != static_cast<int>(kLength))
      throw input_error(file + ": ends in its header of 348 bytes, or its compression is damaged; is it complete?");
    zipped_ = gzdirect(stream.get()) == 0;
    if (get<std::int32_t>(0) != static_cast<int>(kLength)) swapped_ = true;
    if (get<std::int32_t>(0) != static_cast<int>(kLength))
      throw input_error(file + ": does not begin with 348, the length of the header of NIfTI-1; convert it to NIfTI-1");
    const std::string_view magic(bytes_.data() + 344, 4);
    if (magic == std::string_view("ni1\0", 4))
      throw input_error(file + ": its values are in another file; convert it to one file (.nii)");
    if (magic != std::string_view("n+1\0", 4)) throw input_error(file + ": has not the mark 'n+1' of a NIfTI-1 file");
  }

  template <class Number>
  [[nodiscard]] Number get(std::size_t offset) const noexcept {
    std::array<char, sizeof(Number)> own{};
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), own.size(), own.begin());
    if (swapped_) std::reverse(own.begin(), own.end());
    Number number{};
    std::memcpy(&number, own.data(), sizeof number);
    return number;
  }
  [[nodiscard]] double real(std::size_t offset) const noexcept { return static_cast<double>(get<float>(offset)); }
  [[nodiscard]] bool big_endian() const noexcept { return swapped_ != (std::endian::native == std::endian::big); }
  [[nodiscard]] bool zipped() const noexcept { return zipped_; }

 private:
  std::array<char, kLength> bytes_{};
  bool swapped_ = false, zipped_ = false;
};

std::vector<std::uint64_t> nifti_sizes(const NiftiHeader& nifti, const std::string& file) {
  const int dimension = nifti.get<std::int16_t>(40);
  if (dimension < 1 || dimension > 7)
    throw input_error(fmt::format("{}: dim[0] is {}; it must be from 1 to 7", file, dimension));
  std::vector<std::uint64_t> sizes;
  for (int axis = 1; axis <= 7; ++axis) {
    const int size = axis <= dimension ? nifti.get<std::int16_t>(40 + 2 * static_cast<std::size_t>(axis)) : 1;
    if (size < 1) throw input_error(fmt::format("{}: dim[{}] is {}; it must be at least 1", file, axis, size));
    if (axis > 3 && size > 1)
      throw input_error(
          fmt::format("{}: has {} volumes or components (dim[{}]); extract one of them", file, size, axis));
    if (axis <= 3) sizes.push_back(static_cast<std::uint64_t>(size));
  }
  return sizes;
}

ValueType nifti_type(const NiftiHeader& nifti, const std::string& file) {
  const int type = nifti.get<std::int16_t>(70);
  const std::map<int, ValueType> types{{2, ValueType::uint8},    {4, ValueType::int16},    {8, ValueType::int32},
                                       {16, ValueType::float32}, {64, ValueType::float64}, {256, ValueType::int8},
                                       {512, ValueType::uint16}, {768, ValueType::uint32}};
  if (!types.contains(type))
    throw input_error(
        fmt::format("{}: datatype {} is not supported; convert it to {}", file, type, fmt::join(type_names(), ", ")));
  const ValueType known = types.at(type);
  if (static_cast<std::size_t>(nifti.get<std::int16_t>(72)) != 8 * bytes_of(known))
    throw input_error(fmt::format("{}: bitpix is {}, but datatype {} has {} bits", file, nifti.get<std::int16_t>(72),
                                  type, 8 * bytes_of(known)));
  return known;
}

/// Reads where the values begin, and the line that turns them into physical ones.
void read_nifti_scale(const NiftiHeader& nifti, const std::string& file, ValueSource& source) {
  const double offset = nifti.real(108), slope = nifti.real(112), intercept = nifti.real(116);
  if (!(offset >= 352 && offset <= 1e9) || offset != std::floor(offset))
    throw input_error(fmt::format("{}: vox_offset is {}; it must be a whole number from 352", file, offset));
  source.skip = static_cast<std::uint64_t>(offset);
  if (slope == 0) return;
  if (!std::isfinite(slope) || !std::isfinite(intercept))
    throw input_error(fmt::format("{}: scl_slope or scl_inter is not finite", file));
  source.slope = slope;
  source.intercept = intercept;
}

/// Reads the axes and the origin: from the affine matrix, else from the quaternion, else from the spacings alone.
void read_nifti_place(const NiftiHeader& nifti, const std::string& file, Header& header,
                      std::vector<std::string>& remarks) {
  if (nifti.get<std::int16_t>(254) > 0) {
    for (int row = 0; row < 3; ++row) {
      const std::size_t at = 280 + 16 * static_cast<std::size_t>(row);
      for (int axis = 0; axis < 3; ++axis)
        header.steps(row, axis) = nifti.real(at + 4 * static_cast<std::size_t>(axis));
      header.origin[row] = nifti.real(at + 12);
    }
    return;
  }
  const Vec3 spacing(nifti.real(80), nifti.real(84), nifti.real(88));
  if (!(spacing.minCoeff() > 0))
    throw input_error(fmt::format("{}: pixdim[1..3] is {}, {}, {}; spacings must be positive", file, spacing.x(),
                                  spacing.y(), spacing.z()));
  header.steps = spacing.asDiagonal();
  if (nifti.get<std::int16_t>(252) <= 0) {
    remarks.emplace_back("the file states no orientation; its axes are those of the shape");
    return;
  }
  const Vec3 v(nifti.real(256), nifti.real(260), nifti.real(264));
  const double rest = 1 - v.squaredNorm();
  if (!(rest > -1e-5)) throw input_error(file + ": quatern_b, c and d are no rotation: their length exceeds 1");
  const Quat turn = Quat(std::sqrt(std::max(0.0, rest)), v.x(), v.y(), v.z()).normalized();
  const double sign = nifti.real(76) < 0 ? -1 : 1;
  header.steps = turn.toRotationMatrix() * Vec3(spacing.x(), spacing.y(), sign * spacing.z()).asDiagonal();
  header.origin = Vec3(nifti.real(268), nifti.real(272), nifti.real(276));
}

Header read_nifti(const std::string& file, std::vector<std::string>& remarks) {
  const NiftiHeader nifti(file);
  Header header;
  ValueSource& source = header.source;
  source.file = file;
  source.encoding = nifti.zipped() ? ValueSource::Encoding::gzip : ValueSource::Encoding::raw;
  source.big_endian = nifti.big_endian();
  header.sizes = nifti_sizes(nifti, file);
  source.type = nifti_type(nifti, file);
  read_nifti_scale(nifti, file, source);
  read_nifti_place(nifti, file, header, remarks);
  const int units = nifti.get<std::uint8_t>(123) & 7;
  const std::array<const char*, 8> names{"", "m", "mm", "um", "", "", "", ""};
  header.unit = names[static_cast<std::size_t>(units)];
  return header;
}

// --- raw ---

Header read_raw(const std::string& file, std::string& data_file) {
  const nlohmann::json json = load_json(file);
  if (!json.is_object()) throw input_error(file + ": expected an object with the keys file, type and sizes");
  JsonReader reader(json, file);
  Header header;
  data_file = (fs::path(file).parent_path() / reader.require("file").text("file", "")).string();
  header.source.file = data_file;
  const std::vector<std::string> types = type_names();
  header.source.type = find_type(reader.require("type").choice("type", "", types))->type;
  const nlohmann::json sizes = reader.require("sizes").value("sizes");
  const bool whole =
      sizes.is_array() && sizes.size() == 3 && std::all_of(sizes.begin(), sizes.end(), [](const auto& s) {
        return s.is_number_unsigned() && s.template get<std::uint64_t>() > 0;
      });
  if (!whole) throw input_error(file + ": sizes: expected three whole numbers of samples");
  header.sizes = sizes.get<std::vector<std::uint64_t>>();
  header.steps = reader.vector("spacing", Vec3::Ones(), 1e-9, 1e9).asDiagonal();
  header.origin = reader.vector("origin", Vec3::Zero(), -1e9, 1e9);
  const std::array<std::string, 2> endians{"little", "big"};
  header.source.big_endian = reader.choice("endian", "little", endians) == "big";
  header.unit = reader.text("unit", "");
  reader.finish();
  return header;
}

// --- all ---

double metres_of(const std::string& file, const std::string& unit) {
  const Unit* const length = find_unit(unit, "m");
  if (length == nullptr)
    throw input_error(fmt::format("{}: unit '{}' is no length; give m, mm, cm, um or in", file, shown(unit)));
  return 1 / length->per_si;
}

void check_place(const std::string& file, const VolumeData& data, std::vector<std::string>& remarks) {
  const Vec3 sides = data.steps.colwise().norm();
  if (!data.steps.allFinite() || !is_finite(data.origin) || !(data.origin.cwiseAbs().maxCoeff() < kFarthest))
    throw input_error(file + ": the directions or the origin of the grid are not finite, or beyond 1000 km");
  Vec3 size = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis)
    size[axis] = sides[axis] * static_cast<double>(data.size[static_cast<std::size_t>(axis)]);
  if (!(size.maxCoeff() < kFarthest)) throw input_error(file + ": the grid is larger than 1000 km; is its unit right?");
  if (!(sides.minCoeff() > 0) || !(std::abs(data.steps.determinant()) > kFlat * sides.prod()))
    throw input_error(file + ": the axes of the grid do not span the space: one has no length, or two are parallel");
  for (int axis = 0; axis < 3; ++axis) {
    const int next = (axis + 1) % 3;
    const double cosine = data.steps.col(axis).dot(data.steps.col(next)) / (sides[axis] * sides[next]);
    if (std::abs(cosine) > kSkew)
      remarks.push_back(
          fmt::format("axes {} and {} of the grid are at {:.1f} degrees, as of a tilted scanner; the shape "
                      "follows them",
                      axis + 1, next + 1, std::acos(cosine) * 180 / std::numbers::pi));
  }
  if (size.maxCoeff() > kHuge || size.maxCoeff() < kTiny)
    remarks.push_back(fmt::format("the grid is {:.3g} m x {:.3g} m x {:.3g} m large; is its unit right?", size.x(),
                                  size.y(), size.z()));
}

}  // namespace

VolumeLoad load_volume(const std::string& file, const std::string& unit) {
  const double given = unit.empty() ? 0 : metres_of(file, unit);
  std::error_code error;
  if (!fs::is_regular_file(file, error)) throw input_error(file + ": no such file");
  VolumeLoad load;
  Header header;
  const std::string name = lower_case(file), ending = file_ending(file);
  if (ending == ".nrrd" || ending == ".nhdr")
    header = read_nrrd(file, load.data_file, load.remarks);
  else if (ending == ".nii" || name.ends_with(".nii.gz"))
    header = read_nifti(file, load.remarks);
  else if (ending == ".json")
    header = read_raw(file, load.data_file);
  else
    throw input_error(file +
                      ": is no volume that haptrace reads; give .nrrd, .nhdr, .nii, .nii.gz, or .json for raw values");

  if (header.sizes.size() != 3)
    throw input_error(fmt::format("{}: states {} sizes; a volume has 3", file, header.sizes.size()));
  std::uint64_t count = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::uint64_t size = header.sizes[axis];
    if (size < 2)
      throw input_error(fmt::format("{}: has {} sample along axis {}; a volume has at least 2", file, size, axis + 1));
    if (size > kMostVoxels || (count *= size) > kMostVoxels)
      throw input_error(fmt::format("{}: has {} x {} x {} samples; the most is {} million. Cut or thin it out", file,
                                    header.sizes[0], header.sizes[1], header.sizes[2], kMostVoxels / 1'000'000));
    load.data.size[axis] = size;
  }
  double metres = given;
  if (!header.unit.empty()) {
    const double own = metres_of(file, header.unit);
    if (given == 0) metres = own;
    if (given > 0 && std::abs(given / own - 1) > 1e-9)
      load.remarks.push_back(
          fmt::format("the file states the unit {}, but the scene {}, which was taken", shown(header.unit), unit));
  } else if (given == 0) {
    metres = 1e-3;
    load.remarks.emplace_back("the file states no unit of length; it was taken as mm (key 'unit' of the scene)");
  }
  load.data.origin = metres * header.origin;
  load.data.steps = metres * header.steps;
  check_place(file, load.data, load.remarks);
  VolumeValues values = read_values(header.source, count);
  if (values.more)
    load.remarks.push_back(fmt::format("{} continues after its {} x {} x {} values; are its sizes and its type right?",
                                       header.source.file, header.sizes[0], header.sizes[1], header.sizes[2]));
  load.data.values = std::move(values.numbers);
  return load;
}

}  // namespace haptrace
