#include "formats/csv.h"

#include "control/error.h"
#include "formats/output_file.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fmt/format.h>
#include <fstream>
#include <memory>
#include <string_view>

namespace haptrace {
namespace {

constexpr std::array<std::string_view, 10> kNames{"t", "x", "y", "z", "vx", "vy", "vz", "fx", "fy", "fz"};
constexpr std::size_t kRequired = 4, kVelocity = 4, kForce = 7;
constexpr std::size_t kAbsent = static_cast<std::size_t>(-1);

std::string_view trim(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  return first == std::string_view::npos ? std::string_view{}
                                         : text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string_view unquote(std::string_view text) {
  text = trim(text);
  if (text.size() >= 2 && text.front() == text.back() && (text.front() == '"' || text.front() == '\''))
    text = trim(text.substr(1, text.size() - 2));
  return text;
}

/// A text of the file, fit for one line of a message.
std::string shown(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  std::string result(text.substr(0, kLongest));
  for (char& c : result)
    if (static_cast<unsigned char>(c) < ' ') c = '?';
  return text.size() > kLongest ? result + "..." : result;
}

/// The lines of a file, read in blocks.
class Lines {
 public:
  explicit Lines(const std::string& file) : file_(file), stream_(file, std::ios::binary) {
    if (!stream_) throw input_error(fmt::format("{}: cannot be read: {}", file, std::strerror(errno)));
  }

  /// False at the end. `line` stays valid until the next call.
  bool next(std::string_view& line) {
    for (;;) {
      const char* begin = buffer_.data() + begin_;
      const auto* end = static_cast<const char*>(std::memchr(begin, '\n', end_ - begin_));
      if (end == nullptr && refill()) continue;
      if (end == nullptr && begin_ == end_) return false;
      begin = buffer_.data() + begin_;
      const std::size_t length = end != nullptr ? static_cast<std::size_t>(end - begin) : end_ - begin_;
      begin_ += length + (end != nullptr ? 1 : 0);
      line = std::string_view(begin, length);
      if (line.ends_with('\r')) line.remove_suffix(1);
      if (++number_ == 1 && line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
      return true;
    }
  }

  [[nodiscard]] std::size_t number() const { return number_; }

  /// An error in the present line.
  [[nodiscard]] Error error(const std::string& what) const {
    return input_error(fmt::format("{}:{}: {}", file_, number_, what));
  }

 private:
  /// Reads another block behind the unfinished line. False at the end of the file.
  bool refill() {
    constexpr std::size_t kBlock = 1 << 20, kLongestLine = 1 << 20;
    if (end_ - begin_ > kLongestLine)
      throw input_error(fmt::format("{}:{}: no line ends here; is this CSV?", file_, number_ + 1));
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
    buffer_.resize(end_ + kBlock);
    stream_.read(buffer_.data() + end_, kBlock);
    const auto count = static_cast<std::size_t>(stream_.gcount());
    if (stream_.bad()) throw input_error(fmt::format("{}: cannot be read: {}", file_, std::strerror(errno)));
    end_ += count;
    return count > 0;
  }

  std::string file_;
  std::ifstream stream_;
  std::string buffer_;
  std::size_t begin_ = 0, end_ = 0;
  std::size_t number_ = 0;
};

/// Calls `visit(index, field)` for every field and answers how many there were.
template <class Visit>
std::size_t split(std::string_view line, char separator, const Visit& visit) {
  for (std::size_t index = 0;; ++index) {
    const std::size_t end = line.find(separator);
    visit(index, line.substr(0, end));
    if (end == std::string_view::npos) return index + 1;
    line.remove_prefix(end + 1);
  }
}

bool parse(std::string_view field, double& value) {
  if (field.starts_with('+')) field.remove_prefix(1);
  const char* end = field.data() + field.size();
  const auto result = std::from_chars(field.data(), end, value);
  // Beyond the range of double: infinite or, as far as anybody can tell, zero.
  if (result.ec == std::errc::result_out_of_range) value = std::strtod(std::string(field).c_str(), nullptr);
  return result.ec != std::errc::invalid_argument && result.ptr == end;
}

/// What the header says: which field of a row is which column.
struct Header {
  char separator = ',';
  std::size_t fields = 0;
  std::array<std::size_t, kNames.size()> field{};  ///< of each of kNames, or kAbsent
  std::vector<std::size_t> column;                 ///< of each field: index into kNames, or kAbsent
  std::string ignored;                             ///< names, for a note

  [[nodiscard]] bool has(std::size_t first) const { return field[first] != kAbsent; }
};

Header parse_header(const Lines& lines, std::string_view line) {
  if (line.starts_with("\xFF\xFE") || line.starts_with("\xFE\xFF"))
    throw lines.error("the text is UTF-16; save it as UTF-8 or ASCII");
  Header header;
  header.field.fill(kAbsent);
  header.separator = line.find('\t') != std::string_view::npos  ? '\t'
                     : line.find(';') != std::string_view::npos ? ';'
                                                                : ',';
  std::vector<std::string> names;
  bool numeric = true;
  header.fields = split(line, header.separator, [&](std::size_t index, std::string_view text) {
    std::string name(unquote(text));
    double number = 0;
    numeric = numeric && parse(name, number);
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    const auto known = std::find(kNames.begin(), kNames.end(), name);
    const auto column = static_cast<std::size_t>(known - kNames.begin());
    if (known != kNames.end()) {
      if (header.has(column)) throw lines.error(fmt::format("the header names the column {} twice", name));
      header.field[column] = index;
    }
    header.column.push_back(known != kNames.end() ? column : kAbsent);
    names.push_back(name);
  });
  if (numeric)
    throw lines.error(fmt::format("there is no header; the first line must name the columns, as in t,x,y,z; found '{}'",
                                  shown(line)));

  std::vector<std::string_view> missing;
  for (std::size_t column = 0; column < kRequired; ++column)
    if (!header.has(column)) missing.push_back(kNames[column]);
  if (!missing.empty())
    throw lines.error(
        fmt::format("the header lacks {}; it must name t,x,y,z, separated by comma, semicolon or tab; found '{}'",
                    fmt::join(missing, ", "), shown(line)));

  // Of a vector, all components or none.
  for (const std::size_t first : {kVelocity, kForce}) {
    const auto begin = header.field.begin() + static_cast<std::ptrdiff_t>(first);
    if (std::count(begin, begin + 3, kAbsent) == 0) continue;
    for (std::size_t& column : header.column)
      if (column >= first && column < first + 3) column = kAbsent;
    std::fill(begin, begin + 3, kAbsent);
  }
  for (std::size_t i = 0; i < names.size(); ++i)
    if (header.column[i] == kAbsent) header.ignored += (header.ignored.empty() ? "" : ", ") + shown(names[i]);
  return header;
}

double parse_field(const Lines& lines, std::string_view name, std::string_view text) {
  const std::string_view field = unquote(text);
  double value = 0;
  if (parse(field, value)) {
    if (std::isfinite(value)) return value;
    throw lines.error(fmt::format("column {}: '{}' is not a finite number", name, shown(field)));
  }
  if (field.empty()) throw lines.error(fmt::format("column {}: the field is empty", name));
  std::string with_point(field);
  std::replace(with_point.begin(), with_point.end(), ',', '.');
  if (with_point != field && parse(with_point, value))
    throw lines.error(
        fmt::format("column {}: '{}' has a decimal comma; write {} with a point", name, shown(field), with_point));
  throw lines.error(fmt::format("column {}: '{}' is not a number", name, shown(field)));
}

void check_time(const Lines& lines, const Path& path, double t, std::size_t line_before) {
  if (path.time.empty() || t > path.time.back()) return;
  if (t == path.time.back())
    throw lines.error(
        fmt::format("column t: {} s stands in line {} as well; time stamps must increase", t, line_before));
  throw lines.error(fmt::format("column t: {} s comes after {} s in line {}; time stamps must increase", t,
                                path.time.back(), line_before));
}

}  // namespace

Path read_csv(const std::string& file) {
  Lines lines(file);
  std::string_view line;
  bool found = false;
  while (!found && lines.next(line)) found = !trim(line).empty() && !line.starts_with('#');
  if (!found) throw input_error(file + ": is empty; a path has a header t,x,y,z and a row for every sample");
  const Header header = parse_header(lines, line);

  Path path;
  path.name = file;
  if (!header.ignored.empty()) path.notes.push_back("columns left out: " + header.ignored);
  std::array<double, kNames.size()> row{};
  std::size_t line_before = 0, blank = 0;
  while (lines.next(line)) {
    if (trim(line).empty()) {
      blank = blank == 0 ? lines.number() : blank;
      continue;
    }
    if (blank != 0) throw lines.error(fmt::format("line {} is blank, but rows follow it", blank));
    const std::size_t fields = split(line, header.separator, [&](std::size_t index, std::string_view text) {
      const std::size_t column = index < header.fields ? header.column[index] : kAbsent;
      if (column != kAbsent) row[column] = parse_field(lines, kNames[column], text);
    });
    if (fields != header.fields)
      throw lines.error(fmt::format("{} columns where the header has {}{}", fields, header.fields,
                                    header.separator == ',' && fields == 2 * header.fields
                                        ? "; numbers need a decimal point, or semicolons between the columns"
                                        : ""));
    check_time(lines, path, row[0], line_before);
    path.time.push_back(row[0]);
    path.position.emplace_back(row[1], row[2], row[3]);
    if (header.has(kVelocity)) path.velocity.emplace_back(row[4], row[5], row[6]);
    if (header.has(kForce)) path.force.emplace_back(row[7], row[8], row[9]);
    line_before = lines.number();
  }
  if (path.time.empty()) throw lines.error("there is a header but no row");
  return path;
}

void write_csv(const Path& path, const std::string& file, bool overwrite) {
  OutputFile output(file, overwrite);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> stream(std::fopen(output.path().c_str(), "wbx"), &std::fclose);
  const auto refused = [&] {
    return input_error(fmt::format("{}: cannot be written: {}", file, std::strerror(errno)));
  };
  if (!stream) throw refused();
  output.created();

  std::string text = "t,x,y,z";
  if (!path.velocity.empty()) text += ",vx,vy,vz";
  if (!path.force.empty()) text += ",fx,fy,fz";
  text += '\n';
  const auto out = std::back_inserter(text);
  const auto write = [&] {
    if (std::fwrite(text.data(), 1, text.size(), stream.get()) != text.size()) throw refused();
    text.clear();
  };
  for (std::size_t i = 0; i < path.size(); ++i) {
    fmt::format_to(out, "{}", path.time[i]);
    for (const std::vector<Vec3>* column : {&path.position, &path.velocity, &path.force})
      if (!column->empty()) fmt::format_to(out, ",{},{},{}", (*column)[i].x(), (*column)[i].y(), (*column)[i].z());
    text += '\n';
    if (text.size() > 1 << 20) write();
  }
  write();
  if (std::fflush(stream.get()) != 0) throw refused();
  output.commit();
}

}  // namespace haptrace
