//! The wiring of the nine tools: what each takes on its command line (`Args`) and how it joins
//! streams to rooms (`run`). No mathematics and no bytes here.
