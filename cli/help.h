// The help pages of the command, and completions and manual pages made from the same options.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::cli {

/// Returns the words that call `verb`, without "haptrace": "stability map".
std::string full_name(const CLI::App& verb);

/// Returns the whole command that `verb` belongs to.
const CLI::App& root_of(const CLI::App& verb);

/// Returns the long name of an option with its dashes, its short name if it has no other, or a positional's name.
std::string shown_name(const CLI::Option& option);

/// Returns the choices that an option's description lists as "a | b | c"; empty if it lists none.
std::vector<std::string> choices_of(const CLI::Option& option);

/// Returns true if an option takes the name of a file or folder.
bool takes_file(const CLI::Option& option);

/// Breaks a text at blanks into lines of at most `width` columns, if possible.
std::vector<std::string> wrapped(std::string_view text, std::size_t width);

/// The footer of a verb: examples, and the prose around them.
struct Footer {
  std::vector<std::string> examples;  ///< each with an indent of two, on one line or on several that a shell joins
  std::string prose;
};

/// Returns the footer in lines of at most `width` columns, if possible. No line of an example ends inside quotes. The
/// examples are the lines of a footer that begin with two blanks and the command.
Footer footer_of(const CLI::App& app, std::size_t width);

/// Prints help in 80 columns: the purpose of a verb, its usage and examples, then its common options; with --help-all,
/// every option.
class HelpPage final : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override;
};

/// Lets every option of `verb` whose description states an SI unit in brackets, as in "[m/s]", take a value with a
/// unit, such as 20mm. Without a unit, a value is SI.
void accept_units(CLI::App& verb);

/// Returns what is wrong with an option, and what it must be, in plain words.
std::string explained(const CLI::ParseError& error);

}  // namespace haptrace::cli
