# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_scan_capture_global_optspecs
    string join \n n/n-scans= f/frame= angle-jitter= device= baud= poll= for= wait= configure frequency-hz= resolution-deg= range-deg= echoes= remission= mean-scans= particle-filter= divider= encoder= time-block= start save dry-run password-file= tee= tee-rotate= replay= times= no-times epoch= o/output= format= input-format= skip-bad from= to= meta q/quiet v/verbose h/help V/version
end

function __fish_scan_capture_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_scan_capture_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_scan_capture_using_subcommand
    set -l cmd (__fish_scan_capture_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c scan-capture -n "__fish_scan_capture_needs_command" -s n -l n-scans -d 'End after N scans' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -s f -l frame -d 'Frame file: the scanner\'s time from zero index to first beam, its aperture and least range' -r -F
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l angle-jitter -d 'Angle jitter of a SICK\'s motor: FILE takes it out of the scans, learn writes such a file from a recording of a scene at rest' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l device -d 'What kind of scanner it is: SICK\'s CoLa, or Hokuyo\'s SCIP 2.0 (UTM-30LX, port 10940)' -r -f -a "sick\t'LMS5xx, LMS1xx, TiM: CoLa A and B'
hokuyo\t'UTM-30LX: SCIP 2.0'"
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l baud -d 'Speed of the serial port [default: 57600, as delivered]' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l poll -d 'Ask for each scan instead of letting the device send them; HZ times a second [default: once a scan]' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l for -d 'End this long after the first scan' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l wait -d 'How long the scanner may take to be ready [default: 60s]; given, one that refuses connections is waited for as well' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l frequency-hz -d 'Scan frequency; goes with --resolution-deg' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l resolution-deg -d 'Angle from beam to beam; goes with --frequency-hz' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l range-deg -d 'First and last angle that are sent, within -5 and 185' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l echoes -d 'Which echoes are sent' -r -f -a "first\t'The first'
all\t'All, up to five'
last\t'The last, as delivered'"
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l remission -d 'Whether remissions are sent' -r -f -a "on\t''
off\t''"
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l mean-scans -d 'Scans to a mean, 2 to 100; 1 switches the filter off' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l particle-filter -d 'The particle filter' -r -f -a "on\t''
off\t''"
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l divider -d 'Send every N-th scan' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l encoder -d 'Whether encoder values are sent' -r -f -a "on\t''
off\t''"
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l time-block -d 'Whether the device\'s calendar time is sent' -r -f -a "on\t''
off\t''"
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l password-file -d 'File with the password\'s hash, 8 hexadecimal digits [default: CABLEPOSE_PASSWORD, or that of delivery]' -r -F
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l tee -d 'Keep the raw bytes in FILE, and their times of arrival in FILE\'s name with .times.csv' -r -F
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l tee-rotate -d 'Begin a new file (FILE.000, FILE.001 ...) after a size (100MB), an age (10min), or either (100MB|10min)' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l replay -d 'Decode recorded byte streams, one after the other; - is stdin' -r -F
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l times -d 'Arrival times of the bytes: CSV with t_s and offset [default: NAME.times.csv beside NAME.cola]' -r -F
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l epoch -d 'Start of the capture, seconds since 1970 UTC: added to arrival times, or the time of the first scan' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l to -d 'Leave out records after TIME' -r
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l configure -d 'Set the scanner as the following options say, log in for it, and read everything back'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l start -d 'Start the measurement where it has been switched off'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l save -d 'Keep the parameters over power-off (EEPROM)'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l dry-run -d 'Print the telegrams and connect to nothing'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l no-times -d 'Take no notice of arrival times beside the recording'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -s q -l quiet -d 'No progress bar and no remarks'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -s V -l version -d 'Print version'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -a "info" -d 'Say what a scanner is, how it feels and how it is set'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -a "list" -d 'List the serial ports; say what a converter\'s clock makes of a speed'
complete -c scan-capture -n "__fish_scan_capture_needs_command" -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c scan-capture -n "__fish_scan_capture_using_subcommand info" -l baud -d 'Speed of the serial port [default: 57600, as delivered]' -r
complete -c scan-capture -n "__fish_scan_capture_using_subcommand info" -l json -d 'One JSON object'
complete -c scan-capture -n "__fish_scan_capture_using_subcommand info" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c scan-capture -n "__fish_scan_capture_using_subcommand list" -l baud -d 'Wanted speed' -r
complete -c scan-capture -n "__fish_scan_capture_using_subcommand list" -l crystal -d 'Frequency of the converter\'s crystal, such as 16MHz' -r
complete -c scan-capture -n "__fish_scan_capture_using_subcommand list" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c scan-capture -n "__fish_scan_capture_using_subcommand help; and not __fish_seen_subcommand_from info list help" -f -a "info" -d 'Say what a scanner is, how it feels and how it is set'
complete -c scan-capture -n "__fish_scan_capture_using_subcommand help; and not __fish_seen_subcommand_from info list help" -f -a "list" -d 'List the serial ports; say what a converter\'s clock makes of a speed'
complete -c scan-capture -n "__fish_scan_capture_using_subcommand help; and not __fish_seen_subcommand_from info list help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
