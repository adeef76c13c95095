# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_report_global_optspecs
    string join \n truth= desired= association= max-diff= imu= zone= cell-m= fail-if= json html= title= cells ascii o/output= input-format= skip-bad from= to= q/quiet v/verbose format= h/help V/version
end

function __fish_report_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_report_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_report_using_subcommand
    set -l cmd (__fish_report_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c report -n "__fish_report_needs_command" -l truth -d 'True trajectory [default: /truth in the first run\'s stream, if that is MCAP]' -r -F
complete -c report -n "__fish_report_needs_command" -l desired -d 'Desired trajectory, to compare with in place of the truth' -r -F
complete -c report -n "__fish_report_needs_command" -l association -d 'Reference between two of its points: interpolated, or the nearest point' -r
complete -c report -n "__fish_report_needs_command" -l max-diff -d 'Longest time between points interpolated between [default: three spacings], or to the nearest [default: 10ms]' -r
complete -c report -n "__fish_report_needs_command" -l imu -d 'A record of the IMU at rest: Allan deviations beside the 3DM-GX1\'s data sheet; alone, or with poses' -r -F
complete -c report -n "__fish_report_needs_command" -l zone -d 'Score only where the reference pose is, as \'z<=3.5\', \'|y|<4,z>=0.5\', \'z:0.5:3.5\' (m, deg), with a name in front if wanted (low=z<=3.5); several are scored side by side' -r
complete -c report -n "__fish_report_needs_command" -l cell-m -d 'Size of the workspace\'s cells, m [default: from the data]' -r
complete -c report -n "__fish_report_needs_command" -l fail-if -d 'End with status 4 if the condition holds, as \'x.rms_mm>4.1\' or \'joint:yaw.p95_deg>0.2\'; several allowed' -r
complete -c report -n "__fish_report_needs_command" -l html -d 'Write a page with figures' -r -F
complete -c report -n "__fish_report_needs_command" -l title -d 'Title of the page' -r
complete -c report -n "__fish_report_needs_command" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_needs_command" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_needs_command" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_needs_command" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_needs_command" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_needs_command" -l json -d 'Print JSON in place of the table'
complete -c report -n "__fish_report_needs_command" -l cells -d 'Print the workspace\'s cells for y and z too'
complete -c report -n "__fish_report_needs_command" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_needs_command" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_needs_command" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_needs_command" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_needs_command" -s V -l version -d 'Print version'
complete -c report -n "__fish_report_needs_command" -a "lines" -d 'Scores extracted lines against the true ones'
complete -c report -n "__fish_report_using_subcommand lines" -l truth -d 'True segments' -r -F
complete -c report -n "__fish_report_using_subcommand lines" -l point-sigma-cm -d 'Gate: noise of a point' -r
complete -c report -n "__fish_report_using_subcommand lines" -l gate-pct -d 'Gate: probability that a true line passes' -r
complete -c report -n "__fish_report_using_subcommand lines" -l floor-cm -d 'Gate: floor of the offset at a line\'s centre' -r
complete -c report -n "__fish_report_using_subcommand lines" -l floor-deg -d 'Gate: floor of a line\'s direction' -r
complete -c report -n "__fish_report_using_subcommand lines" -l overlap-pct -d 'Least overlap, of the shorter line' -r
complete -c report -n "__fish_report_using_subcommand lines" -l min-points -d 'Fewest beams of a line that counts' -r
complete -c report -n "__fish_report_using_subcommand lines" -l min-length-m -d 'Shortest line that counts' -r
complete -c report -n "__fish_report_using_subcommand lines" -l fail-if -d 'End with status 4 if the condition holds, as \'truepos_pct<93\' or \'ml:nees.mean>2.1\'; several allowed' -r
complete -c report -n "__fish_report_using_subcommand lines" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand lines" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand lines" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand lines" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand lines" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand lines" -l json -d 'Print JSON in place of the table'
complete -c report -n "__fish_report_using_subcommand lines" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_using_subcommand lines" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand lines" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand lines" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand lines" -s h -l help -d 'Print help (see more with \'--help\')'
