//! A bound on the stack depth of an image, from its machine code.
//!
//! The frame of a function is the sum of all instructions that lower the stack pointer (too much
//! for functions with several paths), and its callees are the targets of its branches. A call
//! through a pointer can reach every function whose address occurs in the image, except tasks, and
//! is followed [`INDIRECT`] deep. The interrupt of the urgent task is added, and on top of it the
//! deepest of all others, with the registers that the core saves. The others share one priority,
//! above the first, so they do not nest. Encodings: Arm DDI0403 (ARMv7-M), chapter A7.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Result, bail};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};

/// Calls through pointers below a task: a waker (1), or formatting a panic's message (3).
const INDIRECT: usize = 3;

/// Registers that the core saves for an interrupt, with the floating-point unit's and alignment.
const EXCEPTION_FRAME: u32 = 104 + 4;

/// Parts of the names of functions that run a task, and of the one that runs the urgent task (tasks.rs).
const TASK: &str = "TaskStorage";
const URGENT_TASK: &str = "stamp_task";

/// The interrupt that runs the urgent task (start.rs).
const URGENT_INTERRUPT: &str = "TIM7";

/// Part of the name of the function that every panic calls.
const PANIC: &str = "panic_fmt";

#[derive(Debug, Default)]
struct Function {
    name: String,
    frame: u32,
    calls: BTreeSet<u32>,
    calls_pointers: bool,
}

#[derive(Debug)]
struct Code {
    functions: BTreeMap<u32, Function>,
    pointed_at: BTreeSet<u32>,
    reset: u32,
    interrupts: BTreeSet<u32>,
}

/// Returns a bound on the stack of an image, bytes.
pub(crate) fn bound(image: &object::File<'_>) -> Result<u32> {
    let code = Code::read(image)?;
    let split = |all: BTreeSet<u32>, part: &str| -> (BTreeSet<u32>, BTreeSet<u32>) {
        all.into_iter().partition(|address| code.functions[address].name.contains(part))
    };
    let (tasks, others) = split(&code.pointed_at - &code.interrupts, TASK);
    let (urgent_tasks, tasks) = split(tasks, URGENT_TASK);
    let (urgent, interrupts) = split(code.interrupts.clone(), URGENT_INTERRUPT);
    if tasks.is_empty() || urgent_tasks.is_empty() || urgent.is_empty() {
        bail!("the image does not contain the tasks of a board");
    }
    let mut below = 0;
    for _ in 0..INDIRECT {
        below = code.deepest(&others, below)?;
    }
    // The executor calls tasks, and its other calls are less deep.
    let thread = code.deepest(&BTreeSet::from([code.reset]), code.deepest(&tasks, below)?)?;
    let urgent = code.deepest(&urgent, below.max(code.deepest(&urgent_tasks, below)?))?;
    Ok(thread + urgent + code.deepest(&interrupts, below)? + 2 * EXCEPTION_FRAME)
}

impl Code {
    fn read(file: &object::File<'_>) -> Result<Self> {
        let mut starts = BTreeMap::new();
        let mut data = BTreeMap::new();
        for symbol in file.symbols() {
            let (name, address) = (symbol.name().unwrap_or_default(), symbol.address() as u32);
            match name.split('.').next() {
                Some("$d") => _ = data.insert(address, true),
                Some("$t") => _ = data.insert(address, false),
                _ if symbol.kind() == object::SymbolKind::Text => {
                    starts.insert(address & !1, (name.to_owned(), symbol.size() as u32));
                }
                _ => {}
            }
        }
        let mut functions: BTreeMap<u32, Function> = BTreeMap::new();
        let mut pointers = BTreeSet::new();
        let mut vectors = Vec::new();
        for section in file.sections() {
            let (address, bytes) = (section.address() as u32, section.data()?);
            if section.name()? == ".vector_table" {
                vectors = words(bytes);
            } else if section.kind() == SectionKind::Text {
                let ends = starts.range(address..).skip(1).map(|(&start, _)| start);
                let ends = ends.chain([address + bytes.len() as u32]);
                for ((&start, (name, size)), next) in starts.range(address..).zip(ends) {
                    // Gaps between functions are not code; assembly does not declare its length.
                    let end = if *size == 0 { next } else { next.min(start + size) };
                    let end = end.min(address + bytes.len() as u32);
                    let Some(body) =
                        bytes.get((start - address) as usize..(end - address) as usize)
                    else {
                        break;
                    };
                    let is_data = |at: u32| {
                        data.range(..=at).next_back().is_some_and(|(_, &is_data)| is_data)
                    };
                    let mut function = Function { name: name.clone(), ..Function::default() };
                    scan(&mut function, &mut pointers, start, body, is_data);
                    functions.insert(start, function);
                }
            } else if matches!(section.kind(), SectionKind::ReadOnlyData | SectionKind::Data) {
                pointers.extend(words(bytes));
            }
        }
        let [_, reset, interrupts @ ..] = &vectors[..] else { bail!("no vector table") };
        let is_function =
            |pointer: &u32| pointer & 1 == 1 && functions.contains_key(&(pointer - 1));
        let functions_of = |pointers: &mut dyn Iterator<Item = u32>| -> BTreeSet<u32> {
            pointers.filter(is_function).map(|pointer| pointer - 1).collect()
        };
        let interrupts = functions_of(&mut interrupts.iter().copied());
        let pointed_at = functions_of(&mut pointers.into_iter());
        Ok(Self { reset: reset & !1, interrupts, pointed_at, functions })
    }

    /// Returns the depth of the deepest function, with `below` for calls through pointers.
    fn deepest(&self, roots: &BTreeSet<u32>, below: u32) -> Result<u32> {
        let mut known = BTreeMap::new();
        let mut deepest = 0;
        for &root in roots {
            deepest = deepest.max(self.depth(root, below, &mut known, &mut Vec::new())?);
        }
        Ok(deepest)
    }

    fn depth(
        &self,
        address: u32,
        below: u32,
        known: &mut BTreeMap<u32, u32>,
        path: &mut Vec<u32>,
    ) -> Result<u32> {
        if let Some(&depth) = known.get(&address) {
            return Ok(depth);
        }
        // A branch into the middle of a function uses a second entry.
        let Some((&start, function)) = self.functions.range(..=address).next_back() else {
            bail!("a call to {address:#x}, where there is no function");
        };
        if path.contains(&start) {
            if function.name.contains(PANIC) {
                return Ok(0); // a panic during a panic resets the board
            }
            bail!("`{}` calls itself: no bound on the stack", function.name);
        }
        path.push(start);
        let mut deepest = if function.calls_pointers { below } else { 0 };
        for &call in &function.calls {
            deepest = deepest.max(self.depth(call, below, known, path)?);
        }
        path.pop();
        known.insert(address, function.frame + deepest);
        Ok(function.frame + deepest)
    }
}

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)).collect()
}

fn scan(
    function: &mut Function,
    pointers: &mut BTreeSet<u32>,
    start: u32,
    body: &[u8],
    is_data: impl Fn(u32) -> bool,
) {
    let halves: Vec<u32> =
        body.as_chunks().0.iter().map(|&half| u16::from_le_bytes(half).into()).collect();
    let inside = start..start + body.len() as u32;
    let mut low = [0; 16];
    let mut at = 0;
    while let Some(&first) = halves.get(at) {
        let address = start + 2 * at as u32;
        let second = halves.get(at + 1).copied().unwrap_or(0);
        if is_data(address) {
            if address.is_multiple_of(4) {
                pointers.insert(first | second << 16);
            }
            at += 1;
            continue;
        }
        let wide = first >> 11 >= 0b11101;
        at += if wide { 2 } else { 1 };
        let instruction = if wide { first << 16 | second } else { first };
        function.frame += taken(instruction, wide);
        match branch(instruction, wide) {
            Some(Branch::By(offset)) => {
                let target = address.wrapping_add(4).wrapping_add_signed(offset);
                if !inside.contains(&target) {
                    function.calls.insert(target);
                }
            }
            Some(Branch::Pointer) => function.calls_pointers = true,
            None => {}
        }
        // MOVW and MOVT together load an address.
        let register = (second >> 8 & 0xF) as usize;
        let half =
            (first & 0xF) << 12 | (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF;
        match first & 0xFBF0 {
            0xF240 if wide => low[register] = half,
            0xF2C0 if wide => _ = pointers.insert(half << 16 | low[register]),
            _ => {}
        }
    }
}

fn taken(instruction: u32, wide: bool) -> u32 {
    let low = instruction & 0xFFFF;
    match (wide, instruction >> 16) {
        (false, _) if low & 0xFE00 == 0xB400 => 4 * (low & 0x1FF).count_ones(), // PUSH
        (false, _) if low & 0xFF80 == 0xB080 => 4 * (low & 0x7F),               // SUB SP, #
        (true, 0xE92D) => 4 * low.count_ones(),                                 // PUSH.W
        (true, 0xF84D) if low & 0x0FFF == 0x0D04 => 4,                          // PUSH.W, one
        (true, 0xED2D | 0xED6D) => 4 * (low & 0xFF),                            // VPUSH
        (true, 0xF1AD | 0xF5AD) if low & 0x0F00 == 0x0D00 => modified(instruction),
        (true, 0xF2AD | 0xF6AD) if low & 0x0F00 == 0x0D00 => immediate(instruction), // SUBW
        _ => 0,
    }
}

fn immediate(instruction: u32) -> u32 {
    (instruction >> 26 & 1) << 11 | (instruction >> 12 & 7) << 8 | instruction & 0xFF
}

/// ThumbExpandImm, A5.3.2; its patterns of repeated bytes do not occur as frame sizes.
fn modified(instruction: u32) -> u32 {
    let bits = immediate(instruction);
    match bits >> 10 {
        0 => bits & 0xFF,
        _ => (0x80 | bits & 0x7F).rotate_right(bits >> 7),
    }
}

enum Branch {
    /// Distance to the target, bytes, relative to the instruction's address plus 4.
    By(i32),
    Pointer,
}

/// Returns the branch of an instruction: B, BL, BLX and BX, except returns.
fn branch(instruction: u32, wide: bool) -> Option<Branch> {
    let signed = |value: u32, bits: u32| (value << (32 - bits)).cast_signed() >> (32 - bits);
    let bit = |at: u32| instruction >> at & 1;
    if !wide {
        return match instruction {
            0x4700..=0x47FF if instruction >> 3 & 0xF != 14 => Some(Branch::Pointer),
            0xD000..=0xDDFF => Some(Branch::By(signed(instruction & 0xFF, 8) * 2)),
            0xE000..=0xE7FF => Some(Branch::By(signed(instruction & 0x7FF, 11) * 2)),
            _ => None,
        };
    }
    if instruction & 0xF800_8000 != 0xF000_8000 {
        return None;
    }
    let (sign, j1, j2) = (bit(26), bit(13), bit(11));
    if bit(12) == 1 {
        // B and BL: the bits J encode whether they differ from the sign.
        let (i1, i2) = (1 ^ j1 ^ sign, 1 ^ j2 ^ sign);
        let offset = sign << 23 | i1 << 22 | i2 << 21 | (instruction >> 16 & 0x3FF) << 11;
        return Some(Branch::By(signed(offset | instruction & 0x7FF, 24) * 2));
    }
    if bit(14) == 1 || instruction >> 22 & 0xF >= 0xE {
        return None; // a barrier, a hint or a special register, not a branch
    }
    let offset = sign << 19 | j2 << 18 | j1 << 17 | (instruction >> 16 & 0x3F) << 11;
    Some(Branch::By(signed(offset | instruction & 0x7FF, 20) * 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From listings of `arm-none-eabi-objdump`.
    #[test]
    fn instructions_that_move_the_stack_pointer() {
        for (instruction, wide, bytes) in [
            (0xB5F0, false, 20),        // push {r4, r5, r6, r7, lr}
            (0xB082, false, 8),         // sub sp, #8
            (0xE92D_0F00, true, 16),    // stmdb sp!, {r8, r9, sl, fp}
            (0xF84D_8D04, true, 4),     // str.w r8, [sp, #-4]!
            (0xED2D_8B02, true, 8),     // vpush {d8}
            (0xF5AD_7D02, true, 520),   // sub.w sp, sp, #520
            (0xF5AD_6DB4, true, 1440),  // sub.w sp, sp, #1440
            (0xF1AD_0D40, true, 64),    // sub.w sp, sp, #64
            (0xF2AD_4D04, true, 0x404), // subw sp, sp, #1028
            (0xB002, false, 0),         // add sp, #8
            (0xBDF0, false, 0),         // pop {r4, r5, r6, r7, pc}
        ] {
            assert_eq!(taken(instruction, wide), bytes, "{instruction:#x}");
        }
    }

    #[test]
    fn instructions_that_branch() {
        let by = |instruction, wide| match branch(instruction, wide) {
            Some(Branch::By(offset)) => Some(offset),
            Some(Branch::Pointer) => Some(i32::MAX),
            None => None,
        };
        for (instruction, wide, offset) in [
            (0xF000_F802, true, Some(4)),    // bl .+8
            (0xF7FF_FFFE, true, Some(-4)),   // bl .
            (0xF7FF_BFFE, true, Some(-4)),   // b.w .
            (0xE7FE, false, Some(-4)),       // b.n .
            (0xD0FE, false, Some(-4)),       // beq.n .
            (0xF43F_AFFE, true, Some(-4)),   // beq.w .
            (0x4780, false, Some(i32::MAX)), // blx r0
            (0x4718, false, Some(i32::MAX)), // bx r3
            (0x4770, false, None),           // bx lr
            (0xF3BF_8F4F, true, None),       // dsb sy
            (0xF3EF_8010, true, None),       // mrs r0, PRIMASK
        ] {
            assert_eq!(by(instruction, wide), offset, "{instruction:#x}");
        }
    }
}
