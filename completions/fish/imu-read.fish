# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_imu_read_global_optspecs
    string join \n n/n-samples= for= command= quantities= instant poll= axes= f/frame= accel-sign= quaternion= gains= sigma-tilt-deg= sigma-yaw-deg= sigma-gyro-rad-s= sigma-accel-m-s2= baud= rs485-address= wait= tee= tee-rotate= leave-streaming o/output= format= input-format= skip-bad from= to= meta q/quiet v/verbose h/help V/version
end

function __fish_imu_read_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_imu_read_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_imu_read_using_subcommand
    set -l cmd (__fish_imu_read_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c imu-read -n "__fish_imu_read_needs_command" -s n -l n-samples -d 'End after N samples' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l for -d 'End after TIME (30s, 10min)' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l command -d 'Commands by number or name (0x31, euler, ...); the first is streamed, the others polled [default: 0x31]' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l quantities -d 'Quantities instead of commands: of attitude, accel, gyro, mag' -r -f -a "attitude\t'Roll, pitch, yaw'
accel\t'Acceleration'
gyro\t'Angular rate'
mag\t'Magnetic field'"
complete -c imu-read -n "__fish_imu_read_needs_command" -l poll -d 'Ask for every sample, HZ times a second, instead of having the unit stream' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l axes -d 'Axes of the records: ned, enu or platform (which needs -f)' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -s f -l frame -d 'Frame file: the IMU\'s mounting on the platform' -r -F
complete -c imu-read -n "__fish_imu_read_needs_command" -l accel-sign -d 'The unit\'s accelerations at rest, Z down: force (-1 g on Z) or gravity (+1 g on Z)' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l quaternion -d 'Sense of the unit\'s quaternion: attitude (device to earth) or inverse' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l gains -d 'Gain cells 230, 130, 232 (accel, rate, mag) instead of those read from the unit' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l sigma-tilt-deg -d 'Standard deviation of roll and pitch, deg' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l sigma-yaw-deg -d 'Standard deviation of yaw, deg' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l sigma-gyro-rad-s -d 'Standard deviation of each rate, rad/s' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l sigma-accel-m-s2 -d 'Standard deviation of each acceleration, m/s^2 (noise and a bias of 10 mg)' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l baud -d 'Speed of the unit, Bd [default: found by asking at 38400, 115200 and 19200]' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l rs485-address -d 'Address of the unit on an RS-485 line (needs --poll; commands up to 0x0F)' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l wait -d 'Wait this long for the port and the unit to appear' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l tee -d 'Keep the raw bytes in FILE, with FILE.times.csv and FILE.unit.toml beside it' -r -F
complete -c imu-read -n "__fish_imu_read_needs_command" -l tee-rotate -d 'Begin a new file (FILE.000, FILE.001 ...) after a size (100MB), an age (10min), or either (100MB|10min)' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c imu-read -n "__fish_imu_read_needs_command" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l to -d 'Leave out records after TIME' -r
complete -c imu-read -n "__fish_imu_read_needs_command" -l instant -d 'With --quantities: as the sensors have them at each instant, not gyro-stabilised'
complete -c imu-read -n "__fish_imu_read_needs_command" -l leave-streaming -d 'Leave the unit streaming at the end'
complete -c imu-read -n "__fish_imu_read_needs_command" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c imu-read -n "__fish_imu_read_needs_command" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c imu-read -n "__fish_imu_read_needs_command" -s q -l quiet -d 'No progress bar and no remarks'
complete -c imu-read -n "__fish_imu_read_needs_command" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c imu-read -n "__fish_imu_read_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c imu-read -n "__fish_imu_read_needs_command" -s V -l version -d 'Print version'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "replay" -d 'Decodes a recording (--tee) to the records of the capture'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "info" -d 'Says who the unit is and what its cells hold'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "eeprom" -d 'Shows and sets the unit\'s EEPROM cells'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "bias" -d 'Captures the gyros\' bias; the unit must lie still'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "tare" -d 'Makes the present attitude the zero of the stabilised ones, or forgets that'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "rate" -d 'Shows or sets the unit\'s tick, and says what rates follow'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "check" -d 'Tells from a still unit which of the disputed signs it follows'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "list" -d 'Lists the serial ports with their USB adapters'
complete -c imu-read -n "__fish_imu_read_needs_command" -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -s n -l n-samples -d 'End after N samples' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l times -d 'Arrival times of the bytes [default: NAME.times.csv beside NAME.gx1]' -r -F
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l unit -d 'What the unit was, if NAME.unit.toml is not beside NAME.gx1' -r -F
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l tick -d 'Length of the unit\'s tick, where no unit file says it' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l baud -d 'Speed of the line, Bd, where no unit file says it' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l command -d 'Commands by number or name (0x31, euler, ...); the first is streamed, the others polled [default: 0x31]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l quantities -d 'Quantities instead of commands: of attitude, accel, gyro, mag' -r -f -a "attitude\t'Roll, pitch, yaw'
accel\t'Acceleration'
gyro\t'Angular rate'
mag\t'Magnetic field'"
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l poll -d 'Ask for every sample, HZ times a second, instead of having the unit stream' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l axes -d 'Axes of the records: ned, enu or platform (which needs -f)' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -s f -l frame -d 'Frame file: the IMU\'s mounting on the platform' -r -F
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l accel-sign -d 'The unit\'s accelerations at rest, Z down: force (-1 g on Z) or gravity (+1 g on Z)' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l quaternion -d 'Sense of the unit\'s quaternion: attitude (device to earth) or inverse' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l gains -d 'Gain cells 230, 130, 232 (accel, rate, mag) instead of those read from the unit' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l sigma-tilt-deg -d 'Standard deviation of roll and pitch, deg' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l sigma-yaw-deg -d 'Standard deviation of yaw, deg' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l sigma-gyro-rad-s -d 'Standard deviation of each rate, rad/s' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l sigma-accel-m-s2 -d 'Standard deviation of each acceleration, m/s^2 (noise and a bias of 10 mg)' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l to -d 'Leave out records after TIME' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l no-times -d 'Take no notice of arrival times: stamps are then the unit\'s own time'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l packets -d 'Print every reply of any command, word by word, instead of samples'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l instant -d 'With --quantities: as the sensors have them at each instant, not gyro-stabilised'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -s q -l quiet -d 'No progress bar and no remarks'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c imu-read -n "__fish_imu_read_using_subcommand replay" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c imu-read -n "__fish_imu_read_using_subcommand info" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand info" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand info" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand info" -l json -d 'As JSON'
complete -c imu-read -n "__fish_imu_read_using_subcommand info" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and not __fish_seen_subcommand_from get set dump help" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and not __fish_seen_subcommand_from get set dump help" -f -a "get" -d 'Prints cells'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and not __fish_seen_subcommand_from get set dump help" -f -a "set" -d 'Writes a cell and reads it back. Cells of the factory\'s calibration are refused; --yes does it'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and not __fish_seen_subcommand_from get set dump help" -f -a "dump" -d 'Prints every cell from 0 to 254 as CSV'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and not __fish_seen_subcommand_from get set dump help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from get" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from get" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from get" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from get" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from set" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from set" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from set" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from set" -l force -d 'Also cells that can cut the link or change the scales, and cells of unknown meaning'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from set" -l yes -d 'Do it; without this the bytes are only printed'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from set" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from dump" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from dump" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from dump" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from dump" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from help" -f -a "get" -d 'Prints cells'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from help" -f -a "set" -d 'Writes a cell and reads it back. Cells of the factory\'s calibration are refused; --yes does it'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from help" -f -a "dump" -d 'Prints every cell from 0 to 254 as CSV'
complete -c imu-read -n "__fish_imu_read_using_subcommand eeprom; and __fish_seen_subcommand_from help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c imu-read -n "__fish_imu_read_using_subcommand bias" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand bias" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand bias" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand bias" -l yes -d 'Do it; without this the bytes are only printed'
complete -c imu-read -n "__fish_imu_read_using_subcommand bias" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand tare" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand tare" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand tare" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand tare" -l remove -d 'Forget the tare instead'
complete -c imu-read -n "__fish_imu_read_using_subcommand tare" -l yes -d 'Do it; without this the bytes are only printed'
complete -c imu-read -n "__fish_imu_read_using_subcommand tare" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand rate" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand rate" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand rate" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand rate" -l tick -d 'Set the tick to TIME (10ms, 2ms, 6.5536ms)' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand rate" -l yes -d 'Do it; without this the bytes are only printed'
complete -c imu-read -n "__fish_imu_read_using_subcommand rate" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand check" -l baud -d 'Speed of the unit, Bd [default: found by asking]' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand check" -l rs485-address -d 'Address of the unit on an RS-485 line, where commands up to 0x0F can be asked' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand check" -l wait -d 'Wait this long for the unit to answer' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand check" -s n -l n-answers -d 'Answers of each kind to take the mean of' -r
complete -c imu-read -n "__fish_imu_read_using_subcommand check" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand list" -s h -l help -d 'Print help'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "replay" -d 'Decodes a recording (--tee) to the records of the capture'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "info" -d 'Says who the unit is and what its cells hold'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "eeprom" -d 'Shows and sets the unit\'s EEPROM cells'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "bias" -d 'Captures the gyros\' bias; the unit must lie still'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "tare" -d 'Makes the present attitude the zero of the stabilised ones, or forgets that'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "rate" -d 'Shows or sets the unit\'s tick, and says what rates follow'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "check" -d 'Tells from a still unit which of the disputed signs it follows'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "list" -d 'Lists the serial ports with their USB adapters'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and not __fish_seen_subcommand_from replay info eeprom bias tare rate check list help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and __fish_seen_subcommand_from eeprom" -f -a "get" -d 'Prints cells'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and __fish_seen_subcommand_from eeprom" -f -a "set" -d 'Writes a cell and reads it back. Cells of the factory\'s calibration are refused; --yes does it'
complete -c imu-read -n "__fish_imu_read_using_subcommand help; and __fish_seen_subcommand_from eeprom" -f -a "dump" -d 'Prints every cell from 0 to 254 as CSV'
