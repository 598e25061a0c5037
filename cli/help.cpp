#include "cli/help.h"

#include "base/number.h"
#include "base/units.h"
#include "devices/registry.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <iterator>
#include <regex>
#include <sstream>

namespace haptrace::cli {
namespace {

constexpr std::size_t kPageWidth = 80, kNameWidth = 28;

/// Options that most sessions use, among those that --help-all lists under a heading. Options without a heading are
/// common, too.
constexpr std::array kCommonOptions{
    "--speed",   "--repeat",        "--fit",       "--view",  "--kp",    "--kd",   "--learn",  "--radius",   "--pace",
    "--trigger", "--max-deviation", "--max-force", "--scene", "--title", "--json", "--config", "--stiffness"};

bool is_headed(const CLI::Option& option) {
  return option.get_group() != "Options" && !option.get_group().empty();
}

bool is_common(const CLI::Option& option) {
  return !is_headed(option) ||
         std::find(kCommonOptions.begin(), kCommonOptions.end(), shown_name(option)) != kCommonOptions.end();
}

/// Returns "--kp NUMBER", preceded by the short name if there is one.
std::string left_column(const CLI::Option& option) {
  std::string text;
  for (const std::string& name : option.get_snames()) text += "-" + name + ", ";
  text += shown_name(option);
  if (option.get_items_expected_max() == 0) return text;
  std::string type = option.get_type_name();
  if (type == "FLOAT") type = "NUMBER";
  if (type == "INT" || type == "UINT") type = "N";
  if (option.get_positional()) return type.empty() ? text : type;
  return text + (option.get_items_expected_min() == 0 ? " [" + type + "]" : " " + type);
}

std::string right_column(const CLI::Option& option) {
  std::string text = option.get_description();
  const std::string value = option.get_default_str();
  const bool told = text.find("default") != std::string::npos || text.find("(" + value + ":") != std::string::npos;
  if (!value.empty() && option.get_items_expected_max() > 0 && !told) text += fmt::format(" (default: {})", value);
  return text;
}

std::string two_columns(const std::string& left, const std::string& right) {
  std::string text = "  " + left;
  bool first = true;
  for (const std::string& line : wrapped(right, kPageWidth - kNameWidth)) {
    if (first && text.size() + 1 >= kNameWidth) text += "\n" + std::string(kNameWidth, ' ');
    if (!first) text += "\n" + std::string(kNameWidth, ' ');
    if (first && text.size() < kNameWidth) text.resize(kNameWidth, ' ');
    text += line;
    first = false;
  }
  return text + "\n";
}

std::vector<std::string> lines_of_words(const std::vector<std::string>& words, std::size_t width) {
  std::vector<std::string> lines(1);
  for (const std::string& word : words) {
    if (!lines.back().empty() && lines.back().size() + 1 + word.size() > width) lines.emplace_back();
    lines.back() += (lines.back().empty() ? "" : " ") + word;
  }
  return lines;
}

/// Splits an example at the blanks outside quotes: inside quotes, a shell would keep a line break.
std::vector<std::string> words_of_example(const std::string& example) {
  std::vector<std::string> words(1);
  char quote = 0;
  for (const char c : example) {
    if (c == ' ' && quote == 0) {
      if (!words.back().empty()) words.emplace_back();
      continue;
    }
    if (c == quote)
      quote = 0;
    else if (quote == 0 && (c == '\'' || c == '"'))
      quote = c;
    words.back() += c;
  }
  return words;
}

/// Breaks an example into lines that a shell joins again.
std::string example_text(const std::string& example, std::size_t width) {
  if (example.size() <= width || example.find(" (") != std::string::npos) return example;
  return fmt::format("  {}", fmt::join(lines_of_words(words_of_example(example), width - 10), " \\\n      "));
}

std::string paragraph(std::string_view text, std::size_t width = kPageWidth) {
  return fmt::format("{}\n", fmt::join(wrapped(text, width), "\n"));
}

std::string prose_text(const std::string& prose, std::size_t width = kPageWidth) {
  std::string text, gathered;
  const auto flush = [&] {
    if (!gathered.empty()) text += paragraph(gathered, width);
    gathered.clear();
  };
  std::istringstream lines(prose);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("  ")) {  // formatted by hand
      flush();
      text += line + "\n";
    } else if (line.empty()) {
      flush();
      text += "\n";
    } else {
      gathered += (gathered.empty() ? "" : " ") + line;
    }
  }
  flush();
  return text;
}

std::vector<const CLI::App*> verbs_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* verb) { return !verb->get_name().empty(); });
}

std::vector<std::string> headings_of(const std::vector<const CLI::Option*>& options, bool all) {
  std::vector<std::string> headings;
  for (const CLI::Option* option : options)
    if (is_headed(*option) && (all || !is_common(*option)) &&
        std::find(headings.begin(), headings.end(), option->get_group()) == headings.end())
      headings.push_back(option->get_group());
  return headings;
}

std::string verb_list(const CLI::App& app) {
  std::string text;
  std::vector<std::string> groups;
  for (const CLI::App* verb : verbs_of(app))
    if (std::find(groups.begin(), groups.end(), verb->get_group()) == groups.end()) groups.push_back(verb->get_group());
  for (const std::string& group : groups) {
    text += fmt::format("\n{}:\n", group);
    for (const CLI::App* verb : verbs_of(app))
      if (verb->get_group() == group) text += two_columns(verb->get_name(), verb->get_description());
  }
  return text;
}

std::string option_list(const CLI::App& app, bool all) {
  std::vector<const CLI::Option*> options = app.get_options([](const CLI::Option*) { return true; });
  std::stable_partition(options.begin(), options.end(),
                        [](const CLI::Option* option) { return !shown_name(*option).starts_with("--help"); });
  std::string text;
  for (const bool positional : {true, false})
    for (const CLI::Option* option : options)
      if (option->get_positional() == positional && (all ? !is_headed(*option) : is_common(*option)))
        text += two_columns(left_column(*option), right_column(*option));
  if (!text.empty()) text = "\nOptions:\n" + text;
  const std::vector<std::string> headings = headings_of(options, all);
  for (const std::string& heading : headings) {
    if (!all) break;
    text += fmt::format("\n{}:\n", heading);
    for (const CLI::Option* option : options)
      if (option->get_group() == heading) text += two_columns(left_column(*option), right_column(*option));
  }
  const bool more = std::any_of(options.begin(), options.end(), [](const CLI::Option* o) { return !is_common(*o); });
  if (more && !all) {
    std::string topics = fmt::format("{}", fmt::join(headings, ", "));
    text += "\n" + paragraph(fmt::format("--help-all lists more options: {}.", topics));
  }
  const bool quantities = std::any_of(options.begin(), options.end(), [](const CLI::Option* o) {
    return !bracketed_unit(o->get_description()).empty();
  });
  if (quantities) text += paragraph("Quantities are in SI units, or have a unit: 20mm, 0.5s, 2N, 1kHz.");
  return text;
}

}  // namespace

std::string full_name(const CLI::App& verb) {
  const CLI::App* parent = verb.get_parent();
  if (parent == nullptr) return verb.get_name();
  return parent->get_parent() == nullptr ? verb.get_name() : full_name(*parent) + " " + verb.get_name();
}

const CLI::App& root_of(const CLI::App& verb) {
  return verb.get_parent() == nullptr ? verb : root_of(*verb.get_parent());
}

std::string shown_name(const CLI::Option& option) {
  if (!option.get_lnames().empty()) return "--" + option.get_lnames().front();
  return option.get_snames().empty() ? option.get_name() : "-" + option.get_snames().front();
}

std::vector<std::string> choices_of(const CLI::Option& option) {
  if (option.get_type_name() == "NAME[:...]") {
    std::vector<std::string> devices;
    for (const DeviceBackend& backend : device_backends()) devices.push_back(backend.name);
    return devices;
  }
  // Words separated by |, each optionally with an explanation in parentheses.
  const std::string text = std::regex_replace(option.get_description(), std::regex(R"( \([^)]*\)| *:[A-Z]+\b)"), "");
  std::smatch found;
  if (!std::regex_search(text, found, std::regex(R"([a-z0-9-]+( \| [a-z0-9-]+)+)"))) return {};
  std::vector<std::string> choices;
  const std::string list = found.str();
  const std::regex word("[a-z0-9-]+");
  for (std::sregex_iterator at(list.begin(), list.end(), word), end; at != end; ++at) choices.push_back(at->str());
  return choices;
}

bool takes_file(const CLI::Option& option) {
  static const std::regex kFile("FILE|PATH|FOLDER|DIR|RECORDING|\\.h5|\\.json|\\.csv|SESSION");
  return option.get_items_expected_max() > 0 && std::regex_search(option.get_type_name(), kFile);
}

std::vector<std::string> wrapped(std::string_view text, std::size_t width) {
  std::istringstream words{std::string(text)};
  return lines_of_words({std::istream_iterator<std::string>(words), {}}, width);
}

Footer footer_of(const CLI::App& app, std::size_t width) {
  Footer footer;
  std::string prose;
  std::istringstream lines(app.get_footer());
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("  haptrace "))
      footer.examples.push_back(example_text(line, width));
    else
      prose += line + "\n";
  }
  footer.prose = prose_text(prose, width);
  return footer;
}

std::string HelpPage::make_help(const CLI::App* app, std::string, CLI::AppFormatMode mode) const {
  const bool all = mode == CLI::AppFormatMode::All, top = app->get_parent() == nullptr;
  const Footer footer = footer_of(*app, kPageWidth);
  const std::vector<const CLI::App*> verbs = verbs_of(*app);

  std::string usage = top ? "haptrace" : "haptrace " + full_name(*app);
  if (!verbs.empty()) usage += top ? " VERB" : " EXPERIMENT";
  for (const CLI::Option* option : app->get_options([](const CLI::Option*) { return true; }))
    if (option->get_positional())
      usage += " " + left_column(*option) + (option->get_items_expected_max() > 1 ? "..." : "");
  std::string text = prose_text(app->get_description()) + "\n" + paragraph("Usage: " + usage + " [OPTIONS]");
  if (!footer.examples.empty()) text += fmt::format("\nExamples:\n{}\n", fmt::join(footer.examples, "\n"));
  text += verb_list(*app);
  text += option_list(*app, all);
  if (!footer.prose.empty()) text += "\n" + footer.prose;
  if (!verbs.empty())
    text += "\n" + paragraph(fmt::format("haptrace help {} explains one of them.",
                                         top ? "VERB" : full_name(*app) + " EXPERIMENT"));
  return text;
}

void accept_units(CLI::App& verb) {
  for (CLI::Option* option : verb.get_options()) {
    const std::string unit = bracketed_unit(option->get_description());
    if (unit.empty() || option->get_type_name() != "FLOAT") continue;
    option->transform(
        [unit](const std::string& text) {
          std::string_view rest = text;
          const bool number = take_number<double>(rest).has_value();
          const std::optional<double> value = parse_quantity(text, unit);
          if (!number)
            throw CLI::ValidationError(
                fmt::format("'{}': expected a number, with or without a unit of {}", text, unit));
          if (!rest.empty() && !value)
            throw CLI::ValidationError(
                fmt::format("'{}': '{}' is not a known unit of this quantity; its SI unit is {}", text,
                            rest.substr(std::min(rest.find_first_not_of(' '), rest.size())), unit));
          return value ? fmt::format("{}", *value) : text;
        },
        "");
  }
}

std::string explained(const CLI::ParseError& error) {
  std::string text = error.what();
  const std::string_view cannot = "Could not convert: ", excludes = " excludes ";
  const std::size_t equals = text.find(" = ");
  if (text.starts_with(cannot) && equals != std::string::npos)
    return fmt::format("{} is '{}'; it must be a number without a unit, whole where things are counted",
                       text.substr(cannot.size(), equals - cannot.size()), text.substr(equals + 3));
  if (const std::size_t at = text.find(excludes); at != std::string::npos)
    return fmt::format("{} and {} exclude each other", text.substr(0, at), text.substr(at + excludes.size()));
  return text;
}

}  // namespace haptrace::cli
