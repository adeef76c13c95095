# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_timesync_global_optspecs
    string join \n h/help V/version
end

function __fish_timesync_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_timesync_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_timesync_using_subcommand
    set -l cmd (__fish_timesync_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c timesync -n "__fish_timesync_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_needs_command" -s V -l version -d 'Print version'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "set" -d 'Set a scanner\'s calendar clock to the host\'s (UTC)'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "poll" -d 'Ask a scanner for its time, again and again, and log the exchanges'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "fit" -d 'Offset and drift of a device\'s clock, from a log of exchanges'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "watch" -d 'Watch a scanner\'s clock: a line a second'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "track" -d 'Scans or IMU samples with stamps from the device\'s clock'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "delay" -d 'The delay between a desired trajectory and the measured poses'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "ntp" -d 'Make a scanner the client of a time server, or see how well that goes'
complete -c timesync -n "__fish_timesync_needs_command" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c timesync -n "__fish_timesync_using_subcommand set" -l baud -d 'Speed of a serial line' -r
complete -c timesync -n "__fish_timesync_using_subcommand set" -l timeout -d 'How long an answer may take' -r
complete -c timesync -n "__fish_timesync_using_subcommand set" -l rate -d 'Exchanges a second; their spacing is varied, so that they do not keep step with the scans' -r
complete -c timesync -n "__fish_timesync_using_subcommand set" -l spin -d 'Before and after each request be busy for so long instead of sleeping: a CPU that sleeps wakes up late, and not equally late both ways' -r
complete -c timesync -n "__fish_timesync_using_subcommand set" -l stamp -d 'Which of the device\'s times is asked for' -r -f -a "transmit\t'When the telegram was sent'
scan\t'When the scan was begun: useful one-way only'
calendar\t'The calendar at transmission, whole milliseconds; the time block must be switched on'"
complete -c timesync -n "__fish_timesync_using_subcommand set" -l password-file -d 'File with the 8 hexadecimal digits of the password\'s hash [default: CABLEPOSE_PASSWORD, or the hash of the password with which devices are delivered]' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand set" -l for -d 'How long the clock is watched after each setting' -r
complete -c timesync -n "__fish_timesync_using_subcommand set" -l keep-time-block -d 'Leave the time block on'
complete -c timesync -n "__fish_timesync_using_subcommand set" -l json -d 'Write the result as JSON'
complete -c timesync -n "__fish_timesync_using_subcommand set" -s q -l quiet -d 'No remarks'
complete -c timesync -n "__fish_timesync_using_subcommand set" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l baud -d 'Speed of a serial line' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l timeout -d 'How long an answer may take' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l rate -d 'Exchanges a second; their spacing is varied, so that they do not keep step with the scans' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l spin -d 'Before and after each request be busy for so long instead of sleeping: a CPU that sleeps wakes up late, and not equally late both ways' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l stamp -d 'Which of the device\'s times is asked for' -r -f -a "transmit\t'When the telegram was sent'
scan\t'When the scan was begun: useful one-way only'
calendar\t'The calendar at transmission, whole milliseconds; the time block must be switched on'"
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l for -d 'How long' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -s n -l number -d 'How many exchanges at most' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l to -d 'Leave out records after TIME' -r
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c timesync -n "__fish_timesync_using_subcommand poll" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c timesync -n "__fish_timesync_using_subcommand poll" -s q -l quiet -d 'No progress bar and no remarks'
complete -c timesync -n "__fish_timesync_using_subcommand poll" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c timesync -n "__fish_timesync_using_subcommand poll" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l method -d 'Estimator' -r -f -a "hull\t'Lines under the clouds of requests and of answers, half their difference'
joint\t'The same with one common slope'
one-way\t'The line under the answers alone; the shortest delay stays in it'
mean\t'Least squares through the middles of all exchanges'
minrtt\t'The exchange with the shortest round trip'
window\t'Least squares through the fastest exchange of each second'
weighted\t'Least squares weighted by the round trip, as chrony does'"
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l wire -d 'Take off the time on the wire of request and answer, by their lengths, at this speed: 100Mbit' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l asymmetry -d 'How much longer the shortest answer takes than the shortest request, where it is known; negative where it is the request' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l resamples -d 'How often the log is drawn anew to find the scatter; 0 is never' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l to -d 'Leave out records after TIME' -r
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l json -d 'Write the result as JSON'
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c timesync -n "__fish_timesync_using_subcommand fit" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c timesync -n "__fish_timesync_using_subcommand fit" -s q -l quiet -d 'No progress bar and no remarks'
complete -c timesync -n "__fish_timesync_using_subcommand fit" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c timesync -n "__fish_timesync_using_subcommand fit" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l baud -d 'Speed of a serial line' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l timeout -d 'How long an answer may take' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l rate -d 'Exchanges a second; their spacing is varied, so that they do not keep step with the scans' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l spin -d 'Before and after each request be busy for so long instead of sleeping: a CPU that sleeps wakes up late, and not equally late both ways' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l stamp -d 'Which of the device\'s times is asked for' -r -f -a "transmit\t'When the telegram was sent'
scan\t'When the scan was begun: useful one-way only'
calendar\t'The calendar at transmission, whole milliseconds; the time block must be switched on'"
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l method -d 'Estimator' -r -f -a "hull\t'Lines under the clouds of requests and of answers, half their difference'
joint\t'The same with one common slope'
one-way\t'The line under the answers alone; the shortest delay stays in it'
mean\t'Least squares through the middles of all exchanges'
minrtt\t'The exchange with the shortest round trip'
window\t'Least squares through the fastest exchange of each second'
weighted\t'Least squares weighted by the round trip, as chrony does'"
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l wire -d 'Take off the time on the wire of request and answer, by their lengths, at this speed: 100Mbit' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l asymmetry -d 'How much longer the shortest answer takes than the shortest request, where it is known; negative where it is the request' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l resamples -d 'How often the log is drawn anew to find the scatter; 0 is never' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l for -d 'How long [default: until SIGINT]' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l window -d 'Over which time the line is fitted' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l every -d 'Time between two lines' -r
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l records -d 'Write the exchanges to FILE as clock records, CSV' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand watch" -l json -d 'A line of JSON in place of text'
complete -c timesync -n "__fish_timesync_using_subcommand watch" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand track" -l kind -d 'What the records are [default: told from a CSV file\'s header; scan]' -r -f -a "scan\t'Scans'
imu\t'IMU samples'"
complete -c timesync -n "__fish_timesync_using_subcommand track" -l window -d 'The line is taken from the last half to whole of this time' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -l index-to-first-beam -d 'From the zero index, which a scanner stamps, to its first beam' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -l aperture-start-deg -d 'Where the scanner\'s aperture begins; a scan whose range is cut begins later' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand track" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -l to -d 'Leave out records after TIME' -r
complete -c timesync -n "__fish_timesync_using_subcommand track" -l smooth -d 'Fit the whole file before mapping: not causal, and smoother'
complete -c timesync -n "__fish_timesync_using_subcommand track" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c timesync -n "__fish_timesync_using_subcommand track" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c timesync -n "__fish_timesync_using_subcommand track" -s q -l quiet -d 'No progress bar and no remarks'
complete -c timesync -n "__fish_timesync_using_subcommand track" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c timesync -n "__fish_timesync_using_subcommand track" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l desired -d 'The desired trajectory, CSV or MCAP' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l method -d 'How the delay is found' -r -f -a "fit\t'Delay, gain and offset by weighted, robust least squares'
xcorr\t'Plain cross-correlation: drawn to zero where the platform rests'
parabolic\t'Correlation normalised on each overlap, with a parabola through its peak'
derivative\t'One linear step by the desired velocity'
dissertation\t'As in the dissertation: total delay, cross-correlation, --adjust by hand'"
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l axes -d 'Axes that are used, such as yz [default: those along which the desired trajectory goes]' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l max-delay -d 'The delay is searched between plus and minus this' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l adjust -d 'dissertation: what is added to the delay by hand, with its sign: 8ms, -3ms' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l curve -d 'Write the error that is left for each delay to FILE, records of kind delay' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l curve-step -d 'Step of that curve' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l to -d 'Leave out records after TIME' -r
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l fixed-gain -d 'Take the measurement\'s scale as true'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l fixed-offset -d 'Take the measurement\'s zero as true'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l json -d 'Write the result as JSON (delay_s, sigma_s, ...), which compensate-delay --delay-from reads'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -s q -l quiet -d 'No progress bar and no remarks'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c timesync -n "__fish_timesync_using_subcommand delay" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l baud -d 'Speed of a serial line' -r
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l timeout -d 'How long an answer may take' -r
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l password-file -d 'File with the 8 hexadecimal digits of the password\'s hash [default: CABLEPOSE_PASSWORD, or the hash of the password with which devices are delivered]' -r -F
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l server -d 'Take the time from the server at this address' -r
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l interval -d 'How often the server is asked, whole seconds, 1s to 1h' -r
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l timezone -d 'The device\'s time zone, hours from Greenwich, -12 to 12' -r
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l off -d 'Take the time from nobody'
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l reset-max-offset -d 'Forget the largest offset so far'
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l save -d 'Keep the settings over power-off'
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -l json -d 'Write the result as JSON'
complete -c timesync -n "__fish_timesync_using_subcommand ntp" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "set" -d 'Set a scanner\'s calendar clock to the host\'s (UTC)'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "poll" -d 'Ask a scanner for its time, again and again, and log the exchanges'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "fit" -d 'Offset and drift of a device\'s clock, from a log of exchanges'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "watch" -d 'Watch a scanner\'s clock: a line a second'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "track" -d 'Scans or IMU samples with stamps from the device\'s clock'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "delay" -d 'The delay between a desired trajectory and the measured poses'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "ntp" -d 'Make a scanner the client of a time server, or see how well that goes'
complete -c timesync -n "__fish_timesync_using_subcommand help; and not __fish_seen_subcommand_from set poll fit watch track delay ntp help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
