// Shell completions and manual pages, generated from the options.
#include "base/error.h"
#include "base/output_file.h"
#include "base/text_file.h"
#include "cli/help.h"
#include "cli/terminal.h"
#include "cli/verb.h"
#include "formats/recording/recording.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace::cli {
namespace {

/// Returns every verb that runs something, including sub-commands.
std::vector<const CLI::App*> leaves_of(const CLI::App& app) {
  std::vector<const CLI::App*> leaves;
  for (const CLI::App* verb : app.get_subcommands([](const CLI::App*) { return true; })) {
    const auto inner = leaves_of(*verb);
    if (inner.empty()) leaves.push_back(verb);
    leaves.insert(leaves.end(), inner.begin(), inner.end());
  }
  return leaves;
}

/// Returns `app` and every app below it that has sub-commands.
std::vector<const CLI::App*> parents_of(const CLI::App& app) {
  std::vector<const CLI::App*> parents{&app};
  for (const CLI::App* verb : app.get_subcommands([](const CLI::App*) { return true; }))
    if (!verb->get_subcommands([](const CLI::App*) { return true; }).empty()) parents.push_back(verb);
  return parents;
}

std::vector<const CLI::App*> children_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

std::string name_of(const CLI::App& app) {
  return app.get_parent() == nullptr ? "" : full_name(app);
}

std::vector<const CLI::Option*> options_of(const CLI::App& app) {
  return app.get_options([](const CLI::Option* option) { return !option->get_positional(); });
}

std::string replaced(std::string text, std::string_view from, std::string_view to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

std::string all_names(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  return fmt::format("{}", fmt::join(names, " "));
}

/// Returns the choices that the positional arguments of a verb list, as in "square | circle".
std::vector<std::string> positional_choices(const CLI::App& app) {
  std::vector<std::string> all;
  for (const CLI::Option* option : app.get_options([](const CLI::Option* o) { return o->get_positional(); })) {
    const std::vector<std::string> choices = choices_of(*option);
    all.insert(all.end(), choices.begin(), choices.end());
  }
  return all;
}

/// A word that may stand in the place of a verb, and what it does.
struct VerbWord {
  std::string name, description;
};

/// Returns the verbs below `app`; those of the command include `help`.
std::vector<VerbWord> verb_words(const CLI::App& app) {
  std::vector<VerbWord> words;
  for (const CLI::App* verb : children_of(app)) words.push_back({verb->get_name(), verb->get_description()});
  if (app.get_parent() == nullptr) words.push_back({"help", "print the help page of a verb"});
  return words;
}

// ---- bash ----

std::string bash_completion(const CLI::App& app) {
  std::string text = R"(# bash completion for haptrace; made by `haptrace completion bash`.
_haptrace() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]} verb= word
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    case "$verb $word" in
)";
  for (const CLI::App* parent : parents_of(app))
    for (const CLI::App* verb : children_of(*parent))
      text += fmt::format("      '{} {}') verb='{}' ;;\n", name_of(*parent), verb->get_name(), full_name(*verb));
  text += "    esac\n  done\n  local words= choices=\n  case $verb in\n";
  for (const CLI::App* parent : parents_of(app)) {
    std::vector<std::string> names, options;
    for (const VerbWord& verb : verb_words(*parent)) names.push_back(verb.name);
    for (const CLI::Option* option : options_of(*parent)) options.push_back(all_names(*option));
    text += fmt::format("    '{}') words='{}' choices='{}' ;;\n", name_of(*parent), fmt::join(options, " "),
                        fmt::join(names, " "));
  }
  for (const CLI::App* verb : leaves_of(app)) {
    std::vector<std::string> names, plain;
    text += fmt::format("    '{}')\n      case $prev in\n", full_name(*verb));
    for (const CLI::Option* option : options_of(*verb)) {
      const std::string all = all_names(*option);
      names.push_back(all);
      if (option->get_items_expected_max() == 0) continue;
      const std::vector<std::string> choices = choices_of(*option);
      const std::string pattern = replaced(all, " ", "|");
      if (!choices.empty())
        text += fmt::format("        {}) COMPREPLY=($(compgen -W '{}' -- \"$cur\")); return ;;\n", pattern,
                            fmt::join(choices, " "));
      else if (takes_file(*option))
        text += fmt::format("        {}) COMPREPLY=($(compgen -f -- \"$cur\")); return ;;\n", pattern);
      else
        plain.push_back(pattern);
    }
    if (!plain.empty()) text += fmt::format("        {}) return ;;\n", fmt::join(plain, "|"));
    text += fmt::format("      esac\n      words='{}' choices='{}' ;;\n", fmt::join(names, " "),
                        fmt::join(positional_choices(*verb), " "));
  }
  return text + R"(  esac
  if [[ $cur == -* ]]; then
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
  elif [[ -n $choices ]]; then
    COMPREPLY=($(compgen -W "$choices" -- "$cur"))
  else
    COMPREPLY=($(compgen -f -- "$cur"))
  fi
}
complete -o filenames -o bashdefault -F _haptrace haptrace
)";
}

// ---- zsh ----

/// Escapes a text for a description of _arguments inside single quotes.
std::string zsh_text(std::string text) {
  text = replaced(std::move(text), "\\", "\\\\");
  text = replaced(std::move(text), "'", "'\\''");
  for (const char* special : {"[", "]", ":"}) text = replaced(std::move(text), special, std::string("\\") + special);
  return text;
}

std::string zsh_function(const CLI::App& app) {
  return "_" + replaced(app.get_parent() == nullptr ? "haptrace" : "haptrace " + full_name(app), " ", "_");
}

/// Returns a line of _arguments for each name of each option of a verb.
std::string zsh_options(const CLI::App& app) {
  std::string text;
  for (const CLI::Option* option : options_of(app)) {
    std::string value;
    if (option->get_items_expected_max() > 0) {
      const std::vector<std::string> choices = choices_of(*option);
      value = fmt::format(":{}:{}", zsh_text(option->get_type_name()),
                          !choices.empty()      ? fmt::format("({})", fmt::join(choices, " "))
                          : takes_file(*option) ? "_files"
                                                : "");
    }
    std::istringstream names(all_names(*option));
    for (std::string name; names >> name;)
      text += fmt::format("    '*{}[{}]{}' \\\n", name, zsh_text(option->get_description()), value);
  }
  return text;
}

std::string zsh_completion(const CLI::App& app) {
  std::string text = "#compdef haptrace\n# zsh completion for haptrace; made by `haptrace completion zsh`.\n";
  for (const CLI::App* verb : leaves_of(app)) {
    text += fmt::format("\n{}() {{\n  _arguments -s \\\n", zsh_function(*verb));
    const std::vector<std::string> choices = positional_choices(*verb);
    text += zsh_options(*verb) + (choices.empty() ? "    '*:file:_files'\n}\n"
                                                  : fmt::format("    '*:choice:({})'\n}}\n", fmt::join(choices, " ")));
  }
  const std::vector<const CLI::App*> parents = parents_of(app);
  for (auto parent = parents.rbegin(); parent != parents.rend(); ++parent) {
    text += fmt::format("\n{}() {{\n  local line state\n  local -a verbs=(\n", zsh_function(**parent));
    for (const auto& [name, description] : verb_words(**parent))
      text += fmt::format("    '{}:{}'\n", name, zsh_text(description));
    text += "  )\n  _arguments -C \\\n" + zsh_options(**parent) +
            "    '1: :->verb' '*:: :->rest'\n  case $state in\n"
            "    verb) _describe verb verbs ;;\n    rest)\n      case $line[1] in\n";
    for (const CLI::App* verb : children_of(**parent))
      text += fmt::format("        {}) {} ;;\n", verb->get_name(), zsh_function(*verb));
    if ((*parent)->get_parent() == nullptr) text += "        help) _haptrace ;;\n";
    text += "      esac ;;\n  esac\n}\n";
  }
  return text + "\n_haptrace \"$@\"\n";
}

// ---- fish ----

std::string fish_text(std::string text) {
  return replaced(replaced(std::move(text), "\\", "\\\\"), "'", "\\'");
}

/// Returns the condition that the words of `app` were typed, but none of its sub-commands.
std::string fish_condition(const CLI::App& app) {
  std::vector<std::string> conditions, inner;
  for (const CLI::App* at = &app; at->get_parent() != nullptr; at = at->get_parent())
    conditions.insert(conditions.begin(), "__fish_seen_subcommand_from " + at->get_name());
  for (const CLI::App* verb : children_of(app)) inner.push_back(verb->get_name());
  if (!inner.empty()) conditions.push_back(fmt::format("not __fish_seen_subcommand_from {}", fmt::join(inner, " ")));
  return fmt::format("{}", fmt::join(conditions, "; and "));
}

/// Returns a line for each option of a verb.
std::string fish_options(const CLI::App& app) {
  std::string text;
  for (const CLI::Option* option : options_of(app)) {
    std::string line = fmt::format("complete -c haptrace -n '{}'", fish_condition(app));
    for (const std::string& name : option->get_lnames()) line += " -l " + name;
    for (const std::string& name : option->get_snames()) line += " -s " + name;
    const std::vector<std::string> choices = choices_of(*option);
    if (!choices.empty())
      line += fmt::format(" -x -a '{}'", fmt::join(choices, " "));
    else if (option->get_items_expected_max() > 0)
      line += takes_file(*option) ? " -r -F" : " -x";
    text += fmt::format("{} -d '{}'\n", line, fish_text(option->get_description()));
  }
  return text;
}

std::string fish_completion(const CLI::App& app) {
  std::string text = "# fish completion for haptrace; made by `haptrace completion fish`.\n";
  for (const CLI::App* parent : parents_of(app))
    for (const auto& [name, description] : verb_words(*parent))
      text += fmt::format("complete -c haptrace -f -n '{}' -a {} -d '{}'\n", fish_condition(*parent), name,
                          fish_text(description));
  for (const CLI::App* parent : parents_of(app)) text += fish_options(*parent);
  for (const CLI::App* verb : leaves_of(app)) {
    text += fish_options(*verb);
    if (const std::vector<std::string> choices = positional_choices(*verb); !choices.empty())
      text += fmt::format("complete -c haptrace -f -n '{}' -a '{}'\n", fish_condition(*verb), fmt::join(choices, " "));
  }
  return text;
}

// ---- manual pages ----

std::string roff_text(std::string text) {
  text = replaced(replaced(std::move(text), "\\", "\\e"), "-", "\\-");
  text = replaced(std::move(text), "\n.", "\n\\&.");
  text = replaced(std::move(text), "\n'", "\n\\&'");
  return text.starts_with('.') || text.starts_with('\'') ? "\\&" + text : text;
}

std::string page_name(const CLI::App& app) {
  return app.get_parent() == nullptr ? "haptrace" : "haptrace-" + replaced(full_name(app), " ", "-");
}

std::string manual_page(const CLI::App& app) {
  const std::string name = page_name(app);
  std::string upper = name;
  std::transform(upper.begin(), upper.end(), upper.begin(), [](unsigned char c) { return std::toupper(c); });
  std::string summary = app.get_description();
  summary = summary.substr(0, summary.find('\n'));
  if (summary.ends_with('.')) summary.pop_back();
  const std::vector<const CLI::App*> verbs = children_of(app);
  std::string text =
      fmt::format(".TH {} 1 \"\" \"{}\" \"User Commands\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n.B haptrace",
                  roff_text(upper), software_name(), roff_text(name), roff_text(summary));
  if (app.get_parent() != nullptr) text += " " + roff_text(full_name(app));
  text += "\n";
  if (!verbs.empty()) text += ".I VERB\n";
  for (const CLI::Option* option : app.get_options([](const CLI::Option* o) { return o->get_positional(); }))
    text += ".I " + roff_text(option->get_type_name()) + "\n";
  text += ".RI [ OPTIONS ]\n";
  for (const CLI::App* verb : verbs)
    text += fmt::format("{}.TP\n.B {}\n{}\n", verb == verbs.front() ? ".SH COMMANDS\n" : "",
                        roff_text(verb->get_name()), roff_text(verb->get_description()));
  bool first = true;
  for (const CLI::Option* option : app.get_options([](const CLI::Option*) { return true; })) {
    const std::string names =
        option->get_positional() ? option->get_type_name() : replaced(all_names(*option), " ", ", ");
    text += fmt::format("{}.TP\n.BR \"{}\"", std::exchange(first, false) ? ".SH OPTIONS\n" : "", roff_text(names));
    if (!option->get_positional() && option->get_items_expected_max() > 0)
      text += fmt::format(" \" \\fI{}\\fR\"", roff_text(option->get_type_name()));
    text += "\n" + roff_text(option->get_description());
    if (!option->get_default_str().empty() && option->get_items_expected_max() > 0)
      text += fmt::format(" (default: {})", roff_text(option->get_default_str()));
    text += "\n";
  }
  constexpr std::size_t kTextWidth = 73;  // man indents a text by 7 columns of 80
  const Footer footer = footer_of(app, kTextWidth);
  if (!footer.prose.empty()) text += ".SH NOTES\n.nf\n" + roff_text(footer.prose) + ".fi\n";
  if (!footer.examples.empty())
    text += fmt::format(".SH EXAMPLES\n.nf\n{}\n.fi\n", roff_text(fmt::format("{}", fmt::join(footer.examples, "\n"))));
  if (verbs.empty()) return text + ".SH SEE ALSO\n.BR haptrace (1)\n";
  return text;
}

std::vector<std::pair<std::string, std::string>> files_of(const CLI::App& app, const std::string& shell) {
  if (shell == "bash") return {{"haptrace", bash_completion(app)}};
  if (shell == "zsh") return {{"_haptrace", zsh_completion(app)}};
  if (shell == "fish") return {{"haptrace.fish", fish_completion(app)}};
  if (shell != "man")
    throw input_error(fmt::format("unknown shell '{}'; give bash, zsh, fish, or man for manual pages", shell));
  std::vector<std::pair<std::string, std::string>> pages;
  for (const auto& apps : {parents_of(app), leaves_of(app)})
    for (const CLI::App* page : apps) pages.emplace_back(page_name(*page) + ".1", manual_page(*page));
  return pages;
}

struct CompletionArguments {
  std::string shell, page, folder;
};

}  // namespace

std::vector<Verb> add_completion(CLI::App& app) {
  const auto arguments = std::make_shared<CompletionArguments>();
  CLI::App* verb = app.add_subcommand("completion", "print completions for a shell, or manual pages");
  verb->footer(
      "  haptrace completion bash > ~/.local/share/bash-completion/completions/haptrace\n"
      "  haptrace completion zsh > ~/.zfunc/_haptrace\n"
      "  haptrace completion fish > ~/.config/fish/completions/haptrace.fish\n"
      "  haptrace completion man -o ~/.local/share/man/man1\n"
      "The package installs all of them.");
  verb->add_option("shell", arguments->shell, "bash | zsh | fish | man")->type_name("SHELL");
  verb->add_option("page", arguments->page, "manual page to print: haptrace, or haptrace-VERB")->type_name("[PAGE]");
  verb->add_option("-o,--output", arguments->folder, "write files with their usual names into this folder")
      ->type_name("FOLDER");
  return {{verb, [arguments, verb](const Output&) {
             require(*verb, "shell");
             const auto files = files_of(root_of(*verb), arguments->shell);
             if (!arguments->folder.empty()) {
               std::filesystem::create_directories(arguments->folder);
               for (const auto& [name, text] : files) {
                 TextWriter file(arguments->folder + "/" + name, true);
                 file.text() = text;
                 file.commit();
               }
               return kDone;
             }
             const std::string page = (arguments->page.empty() ? "haptrace" : arguments->page) + ".1";
             for (const auto& [name, text] : files)
               if (files.size() == 1 || name == page) {
                 write_out(stdout, text);
                 return kDone;
               }
             throw input_error(fmt::format("there is no manual page '{}'; haptrace --help lists the verbs", page));
           }}};
}

}  // namespace haptrace::cli
