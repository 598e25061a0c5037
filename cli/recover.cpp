#include "cli/read_progress.h"
#include "cli/verb.h"
#include "formats/recording/recording_recover.h"

#include <fmt/format.h>

namespace haptrace::cli {

Verb add_recover(CLI::App& app) {
  struct Arguments {
    std::string file, output;
    bool overwrite = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("recover", "make a recording whole again whose writer was killed");
  verb->footer(
      "Writes what can be read into a new file, proves that it is there, and only then puts it in the old one's "
      "place.\n"
      "Every verb reads an unfinished recording as it is; programs other than haptrace may not.\n"
      "  haptrace recover session.h5");
  verb->add_option("file", arguments->file, "recording (HDF5)")->type_name("FILE.h5");
  verb->add_option("-o,--output", arguments->output, "leave FILE.h5 as it is and write this file")->type_name("OUT.h5");
  verb->add_flag("--overwrite", arguments->overwrite, "replace OUT.h5 if it exists");
  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            keep_inputs(arguments->output, std::span(&arguments->file, 1));
            clean_up(output, arguments->output.empty() ? arguments->file : arguments->output);
            Recovery recovery;
            {
              ReadProgress progress(output, arguments->file);
              recovery = recover_recording(arguments->file, arguments->output, arguments->overwrite,
                                           progress.share_callback());
            }
            for (const std::string& note : recovery.notes) output.remark(note);
            const std::string text =
                !recovery.needed
                    ? fmt::format("{}: is whole, {} samples; nothing to do\n", arguments->file, recovery.samples)
                    : fmt::format("{}: {} samples recovered{}\n", fmt::join(recovery.files, ", "), recovery.samples,
                                  recovery.unreadable > 0 ? fmt::format(", {} could not be read", recovery.unreadable)
                                                          : std::string());
            output.tell({{"file", arguments->file},
                         {"needed", recovery.needed},
                         {"samples", recovery.samples},
                         {"unreadable", recovery.unreadable},
                         {"damaged", recovery.damaged},
                         {"files", recovery.files},
                         {"notes", recovery.notes}},
                        text);
            return recovery.unreadable > 0 || recovery.damaged ? kStopped : kDone;
          }};
}

}  // namespace haptrace::cli
