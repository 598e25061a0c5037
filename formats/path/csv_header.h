// Head of a CSV file: its columns, units and time stamps. Private to formats.
#pragma once

#include "base/units.h"
#include "formats/convert/sample_text.h"
#include "formats/path/csv_options.h"

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Notation of a row's time.
enum class StampForm {
  number,  ///< in any unit; the cell holds seconds on the file's own time scale
  exact,   ///< a number so large that it is read as a decimal and counted from the first row
  date,    ///< date and time
  time_of_day
};

/// Head of a CSV file, and the rules for reading its rows.
struct CsvHeader {
  static constexpr std::size_t kPassedOver = std::numeric_limits<std::size_t>::max();

  struct Field {
    std::size_t cell = kPassedOver;
    double per_si = 1;  ///< the value is divided by this
  };

  bool recording = false;             ///< haptrace wrote the file, and nothing is assumed
  std::vector<std::string> comments;  ///< "haptrace {...}", "event {...}" and "clock {...}"
  std::size_t last_line = 0;          ///< last line before the rows
  char separator = ',';
  std::vector<Field> fields;        ///< by field of a row
  std::vector<std::string> labels;  ///< by cell, for messages: "x" or "x ('Pos X')"
  std::vector<bool> present;        ///< by text column
  std::string ignored;              ///< names of columns that are not read, for a note

  StampForm stamps = StampForm::number;
  std::optional<std::size_t> date_field;  ///< field with the date of a time of day
  double stamps_per_second = 1;
  std::int64_t start_ns = 0;  ///< unless `number`: stamp of the first row, which becomes time 0

  bool position_unit_known = false;
  bool drops_lost_rows = false;    ///< rows without a position are left out and counted
  std::vector<std::string> notes;  ///< sentences about what was recognised and assumed
};

/// Reads the head of `file`. The caller wants the first `columns` of text_columns(). Throws Error(input) like
/// CsvReader, and naming --columns or --units if a user names something that the file does not have.
CsvHeader read_csv_header(const std::string& file, std::size_t columns, const CsvOptions& options);

/// Returns the units of --units by their SI quantity. Throws Error(input).
std::map<std::string_view, const Unit*> asked_units(const CsvOptions& options);

/// Returns the text without surrounding blanks and without one pair of quotes.
std::string_view unquoted(std::string_view text);

/// Result of split_csv for a line with an unclosed quote.
inline constexpr std::size_t kOpenQuote = std::numeric_limits<std::size_t>::max();

/// Calls `visit(index, field, quoted)` for every field of a line. Returns the number of fields, or kOpenQuote. For a
/// field in quotes (RFC 4180), `field` is the text between them.
template <class Visit>
std::size_t split_csv(std::string_view line, char separator, const Visit& visit) {
  for (std::size_t index = 0;; ++index) {
    const std::size_t begin = line.find_first_not_of(separator == '\t' ? " " : " \t");
    std::size_t end = std::string_view::npos;
    bool quoted = false;
    if (begin != std::string_view::npos && line[begin] == '"') {
      std::size_t close = line.find('"', begin + 1);
      while (close != std::string_view::npos && close + 1 < line.size() && line[close + 1] == '"')
        close = line.find('"', close + 2);
      if (close == std::string_view::npos) return kOpenQuote;
      const std::size_t after = line.find_first_not_of(separator == '\t' ? " " : " \t", close + 1);
      quoted = after == std::string_view::npos || line[after] == separator;
      if (quoted) {
        visit(index, line.substr(begin + 1, close - begin - 1), true);
        end = after;
      }
    }
    if (!quoted) {
      end = line.find(separator);
      visit(index, unquoted(line.substr(0, end)), false);
    }
    if (end == std::string_view::npos) return index + 1;
    line.remove_prefix(end + 1);
  }
}

/// Notation of a number.
enum class NumberForm { none, whole, point, comma };

/// Reads a number. Accepts a decimal comma only if `comma` is true.
NumberForm parse_csv_number(std::string_view field, bool comma, double& value);

/// Reads a stamp in the header's form [ns]. `date` is the date for a time of day, or empty.
std::optional<std::int64_t> parse_stamp(const CsvHeader& header, std::string_view text, std::string_view date,
                                        bool comma);

/// Number of cells that a path must have: t,x,y,z.
inline constexpr std::size_t kRequiredCells = 4;

/// Longest plausible distance from the origin without a unit [m].
inline constexpr double kFarthestWithoutUnit = 5;

}  // namespace haptrace
